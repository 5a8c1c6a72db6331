"""Help of the commands: all of them by groups, the options of one by groups, its example."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Final

from typer.core import TyperGroup

GROUPS: Final = {
    "One moment": ("run", "report", "view", "encounters", "plot"),
    "Recordings": ("inspect", "rank", "catalogue", "validate", "metrics"),
    "A running SUMO": ("watch",),
    "Drivers": ("models", "test", "train"),
    "Maps and files": ("convert", "generate", "export"),
}
"""Commands by what one wants, in the order of the help; those of other packages follow."""

NAME_WIDTH: Final = 10
"""Characters of a command's name in the list of all."""


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


def write_options(params: Iterable[Any], shared: str, ctx: Any, formatter: Any) -> None:
    """Write arguments and options by their groups; ``--help`` is in that of the shared options."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for param in params:
        record = param.get_help_record(ctx)
        if record is not None:
            panel = getattr(param, "rich_help_panel", None) or "Options"
            panel = shared if param.name == "help" else panel
            group = "Arguments" if param.param_type_name == "argument" else panel
            groups.setdefault(group, []).append(record)
    for name, records in groups.items():
        with formatter.section(name):
            formatter.write_dl(records)


def write_example(command: str, formatter: Any) -> None:
    """Write an example on lines that can be copied."""
    with formatter.section("Example"):
        for line in copyable(command, formatter.width - 2):
            formatter.write(f"  {line}\n")


def copyable(command: str, width: int) -> list[str]:
    """Break a command line before options, by backslashes, where it is longer than a width in characters."""
    lines: list[str] = []
    for piece in re.split(r" (?=-)", command):
        joined = f"{lines[-1]} {piece}" if lines else piece
        if not lines or len(joined) > width - 2:  # of the backslash
            lines.append(f"    {piece}" if lines else piece)
        else:
            lines[-1] = joined
    return [*(f"{line} \\" for line in lines[:-1]), lines[-1]]
