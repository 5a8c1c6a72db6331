"""Options of every command: ``--config``, ``--quiet``, ``--verbose``; ``--json`` of those with an answer."""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from typer import Option
from typer.core import TyperCommand

from scex_sumo.base.importing import Registry
from scex_sumo.commands import console

COMMANDS = Registry(
    group="scex_sumo.commands",
    kind="command",
    builtin={
        "run": "scex_sumo.commands.run:run_command",
        "models": "scex_sumo.commands.models:models_command",
    },
)
"""A command is a function with Typer options; ``EXAMPLE`` in its module ends its help."""

Answer = Callable[[], dict[str, Any]]
"""What a command with ``--json`` returns: a function that makes its answer."""


class Command(TyperCommand):
    """Command with the shared options."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; print its answer alone if ``--json`` is given."""
        given = {name: ctx.params.pop(name, None) for name in ("config", "quiet", "verbose", "json")}
        console.level = bool(given["verbose"]) - bool(given["quiet"])
        if ctx.default_map:
            from scex_sumo.commands.config import words_of

            sys.argv[1:] = [ctx.info_name, *words_of(self, ctx)]  # what repeats it without the file
        if not given["json"]:
            super().invoke(ctx)
            return None
        with _elsewhere() as stdout:
            answer = super().invoke(ctx)()
            stdout.write(json.dumps(plain(answer), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        return None


def with_shared(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command's function with the parameters of the shared options, which `Command` takes."""
    signature = inspect.signature(function, eval_str=True)
    flags: list[tuple[str, ...]] = [("-q", "--quiet", "No notes and no progress; warnings stay.")]
    flags += [("-v", "--verbose", "Notes in full; the origin of an error.")]
    if signature.return_annotation == Answer:
        flags += [("--json", "Print the answer as JSON, nothing else.")]
    config = Option(
        "--config",
        metavar="FILE",
        help="Options of a TOML file, or of a run.json to repeat that run; those given here win.",
        is_eager=True,
        callback=_take_config,
    )
    shared: list[tuple[str, Any, Any]] = [("config", Annotated[str | None, config], None)]
    for *names, text in flags:
        option = Annotated[bool, Option(*names, help=text, is_eager=True)]
        shared.append((names[-1].removeprefix("--"), option, False))

    @functools.wraps(function)
    def command(**values: Any) -> Any:
        return function(**{name: value for name, value in values.items() if name in signature.parameters})

    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, kind, default in shared
    ]
    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *more])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in command.__signature__.parameters.values()}  # type: ignore[attr-defined]
    return command


@contextlib.contextmanager
def _elsewhere() -> Iterator[Any]:
    """Yield standard output; meanwhile what Python prints is dropped, and what SUMO prints goes to errors."""
    stdout = sys.stdout
    stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with (
            os.fdopen(os.dup(kept), "w", encoding="utf-8") as file,
            contextlib.redirect_stdout(io.StringIO()),
        ):
            yield file
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def plain(value: Any) -> Any:
    """Return a value as JSON has it: NaN is null, infinity ``"inf"``, arrays and tuples are lists."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _take_config(ctx: Any, _param: Any, value: str | None) -> None:
    if value is not None and not ctx.resilient_parsing:
        from scex_sumo.commands.config import options_of_file

        ctx.default_map = options_of_file(ctx, Path(value))
