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
from typer.core import TyperArgument, TyperCommand

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.base.importing import Registry
from scex_sumo.commands import console

COMMANDS = Registry(
    group="scex_sumo.commands",
    kind="command",
    builtin={
        "run": "scex_sumo.commands.run:run_command",
        "plot": "scex_sumo.commands.plot:plot_command",
        "models": "scex_sumo.commands.models:models_command",
    },
)
"""A command is a function with Typer options; ``EXAMPLE`` in its module ends its help."""

Answer = Callable[[], dict[str, Any]]
"""What a command with ``--json`` returns: a function that makes its answer."""

_SHARED = ("config", "quiet", "verbose", "json", "help")


class Command(TyperCommand):
    """Command with the shared options."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; print its answer alone if ``--json`` is given."""
        given = {name: ctx.params.pop(name, None) for name in ("config", "quiet", "verbose", "json")}
        console.level = bool(given["verbose"]) - bool(given["quiet"])
        if ctx.default_map:
            sys.argv[1:] = [ctx.info_name, *_words(self, ctx)]  # what repeats it without the file
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
    if value is None or ctx.resilient_parsing:
        return
    ctx.default_map = _of_run(ctx, Path(value)) if value.endswith(".json") else _of_toml(ctx, Path(value))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(
            f"--config {path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None


def _of_run(ctx: Any, path: Path) -> dict[str, Any]:
    """Return the options of the command line in a ``run.json``."""
    try:
        words = json.loads(_read(path))["command"]
        program, name, *words = words
    except (ValueError, KeyError, TypeError):
        raise UsageError(
            f"--config {path}: holds no command; only runs of the command line can be repeated"
        ) from None
    if name != ctx.info_name:
        raise UsageError(f"--config {path}: is of {program} {name}; give it to that command")
    return {
        k: v
        for k, v in ctx.command.make_parser(ctx).parse_args([str(w) for w in words])[0].items()
        if _set(v)
    }


def _set(value: Any) -> bool:
    return value is not None and type(value).__name__ != "Sentinel" and value != () and value != []


def _of_toml(ctx: Any, path: Path) -> dict[str, Any]:
    """Return the options of a TOML file, whose keys are long options without dashes, or arguments."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib

    try:
        content = tomllib.loads(_read(path))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"--config {path}: {error}") from None
    known, found = _keys(ctx.command), {}
    for key, value in content.items():
        param, positive = known.get(key.replace("_", "-"), (None, True))
        if param is None:
            raise UsageError(f"--config {path}: unknown key {key!r}; nearest: {nearest(key, known)}")
        found[param.name] = _value(param, value, path, key, positive=positive)
    return found


def _keys(command: TyperCommand) -> dict[str, tuple[Any, bool]]:
    """Return each key's parameter, and whether true means to set it: ``no-report = true`` clears it."""
    keys: dict[str, tuple[Any, bool]] = {}
    for param in command.params:
        if isinstance(param, TyperArgument):
            keys[(param.metavar or str(param.name)).rstrip(".").lower().split("|")[0]] = param, True
    for param in command.params:
        if not isinstance(param, TyperArgument) and param.name not in _SHARED:
            keys |= {name[2:]: (param, True) for name in param.opts if name.startswith("--")}
            keys |= {name[2:]: (param, False) for name in param.secondary_opts if name.startswith("--")}
    return keys


def _value(param: Any, value: Any, path: Path, key: str, *, positive: bool) -> Any:
    """Return a TOML value as an option takes it: lists are joined by commas, tables become ``KEY=VALUE``.

    Paths are relative to the folder of the file.
    """
    several = getattr(param, "multiple", False) or param.nargs == -1
    entries = [f"{k}={v}" for k, v in value.items()] if isinstance(value, dict) else value
    if getattr(param, "is_flag", False):
        if not isinstance(value, bool):
            raise UsageError(f"--config {path}: {key} is {value!r}, needs true or false")
        return value is positive
    each = [str(entry) for entry in (entries if isinstance(entries, list) else [entries])]
    if param.type.name in ("path", "file", "directory"):
        each = [str(path.parent / entry) for entry in each]
    return each if several else ",".join(each)


def _words(command: TyperCommand, ctx: Any) -> list[str]:
    """Return the command line of all that is given, by the file or here."""
    words: list[str] = []
    last: list[str] = []
    for param in command.params:
        source = ctx.get_parameter_source(param.name)
        if param.name in _SHARED or source is None or source.name not in ("COMMANDLINE", "DEFAULT_MAP"):
            continue
        value = ctx.params[param.name]
        each = list(value) if isinstance(value, list | tuple) else [value]
        if isinstance(param, TyperArgument):
            last += map(str, each)
        elif getattr(param, "is_flag", False):
            words += (
                [param.opts[0] if value else param.secondary_opts[0]] if value or param.secondary_opts else []
            )
        else:
            words += [word for one in each for word in (param.opts[-1], str(one))]
    return [*words, *(["--"] if any(word.startswith("-") for word in last) else []), *last]
