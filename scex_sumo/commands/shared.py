"""Help of the commands, and options of all: ``--config``, ``--quiet``, ``--verbose``, ``--json``."""

from __future__ import annotations

import functools
import inspect
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

from typer import Option
from typer.core import TyperCommand, TyperGroup

from scex_sumo.base.importing import Registry, import_arrow
from scex_sumo.commands import console

COMMANDS = Registry(group="scex_sumo.commands", kind="command")
"""A command is a function with Typer options; ``EXAMPLE`` in its module ends its help."""

GROUPS: Final = {
    "One moment": ("run", "report", "view", "encounters", "plot"),
    "Recordings": ("inspect", "rank", "catalogue", "validate", "metrics"),
    "A running SUMO": ("watch",),
    "Drivers": ("models", "test", "train"),
    "Maps and files": ("convert", "generate", "export"),
}
"""Commands by what one wants, in the order of the help; those of other packages follow."""

WITHOUT_ARROW = ("convert", "models")
"""Commands that start quicker."""

Answer = Callable[[], dict[str, Any]]
"""What a command with ``--json`` returns: a function that makes its answer."""


NAME_WIDTH: Final = 10
"""Characters of a command's name in the list of all."""

OF_EVERY_COMMAND: Final = "Every command"
"""Group of the shared options in the help."""


class CommandGroup(TyperGroup):
    """All commands, listed by `GROUPS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each group."""
        others = self.commands.keys() - {name for names in GROUPS.values() for name in names}
        for title, names in {**GROUPS, "Of other packages": tuple(sorted(others))}.items():
            commands = [self.commands[name] for name in names if name in self.commands]
            if commands:
                with formatter.section(title):
                    limit = formatter.width - NAME_WIDTH - 4  # indent, gap
                    records = [(f"{c.name:<{NAME_WIDTH}}", c.get_short_help_str(limit)) for c in commands]
                    formatter.write_dl(records)


class Command(TyperCommand):
    """Command with the shared options; its epilog is an example."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options by their groups."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                panel = getattr(param, "rich_help_panel", None) or "Options"
                panel = OF_EVERY_COMMAND if param.name == "help" else panel
                group = "Arguments" if param.param_type_name == "argument" else panel
                groups.setdefault(group, []).append(record)
        for name, records in groups.items():
            with formatter.section(name):
                formatter.write_dl(records)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the example on lines that can be copied."""
        with formatter.section("Example"):
            for line in copyable(self.epilog or "", formatter.width - 2):
                formatter.write(f"  {line}\n")

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


def copyable(command: str, width: int) -> list[str]:
    """Break a command line before options, by backslashes, where it is longer than a width in characters."""
    lines: list[str] = []
    for part in re.split(r" (?=-)", command):
        joined = f"{lines[-1]} {part}" if lines else part
        if not lines or len(joined) > width - 2:  # of the backslash
            lines.append(f"    {part}" if lines else part)
        else:
            lines[-1] = joined
    return [*(f"{line} \\" for line in lines[:-1]), lines[-1]]


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
    shared: list[tuple[str, Any, Any]] = [("config", Annotated[str | None, config], None)]
    for *names, text in flags:
        option = Annotated[bool, Option(*names, help=text, is_eager=True, rich_help_panel=OF_EVERY_COMMAND)]
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


def _take_config(ctx: Any, _param: Any, value: str | None) -> None:
    if value is not None and not ctx.resilient_parsing:
        from scex_sumo.commands.config import options_of_file

        ctx.default_map = options_of_file(ctx, Path(value))
