"""Registry of the commands, and options of all: ``--config``, ``--quiet``, ``--verbose``, ``--json``."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

from typer import Option
from typer.core import TyperCommand

from scex_sumo.base.importing import Registry, import_arrow
from scex_sumo.commands import console

COMMANDS = Registry(group="scex_sumo.commands", kind="command")
"""A command is a function with Typer options; ``EXAMPLE`` in its module ends its help."""

WITHOUT_ARROW = ("convert", "models")
"""Commands that start quicker."""

Answer = Callable[[], dict[str, Any]]
"""What a command with ``--json`` returns: a function that makes its answer."""


OF_EVERY_COMMAND: Final = "Every command"
"""Group of the shared options in the help."""


class Command(TyperCommand):
    """Command with the shared options; its epilog is an example."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options by their groups."""
        from scex_sumo.commands.help import write_options

        write_options(self.get_params(ctx), OF_EVERY_COMMAND, ctx, formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the example on lines that can be copied."""
        from scex_sumo.commands.help import write_example

        write_example(self.epilog or "", formatter)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; print its answer alone if ``--json`` is given."""
        given = {name: ctx.params.pop(name, None) for name in ("config", "quiet", "verbose", "json")}
        console.level = bool(given["verbose"]) - bool(given["quiet"])
        if ctx.default_map:
            from scex_sumo.commands.config import words_of

            sys.argv[1:] = [ctx.info_name, *words_of(self, ctx)]  # what repeats it without the file
        if ctx.info_name not in WITHOUT_ARROW:
            import_arrow()
        if not given["json"]:
            super().invoke(ctx)
            return None
        from scex_sumo.commands.json_output import print_alone

        print_alone(lambda: super(Command, self).invoke(ctx)())
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
        rich_help_panel=OF_EVERY_COMMAND,
    )
    keyword = inspect.Parameter.KEYWORD_ONLY
    more = [inspect.Parameter("config", keyword, default=None, annotation=Annotated[str | None, config])]
    for *names, text in flags:
        option = Annotated[bool, Option(*names, help=text, is_eager=True, rich_help_panel=OF_EVERY_COMMAND)]
        name = names[-1].removeprefix("--")
        more.append(inspect.Parameter(name, keyword, default=False, annotation=option))

    @functools.wraps(function)
    def command(**values: Any) -> Any:
        return function(**{name: value for name, value in values.items() if name in signature.parameters})

    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *more])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in command.__signature__.parameters.values()}  # type: ignore[attr-defined]
    return command


def _take_config(ctx: Any, _param: Any, value: str | None) -> None:
    if value is not None and not ctx.resilient_parsing:
        from scex_sumo.commands.config import options_of_file

        ctx.default_map = options_of_file(ctx, Path(value))
