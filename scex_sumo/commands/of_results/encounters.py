"""``scex-sumo encounters``: who meets whom in a run, how critical it gets, and by whose models."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Annotated, Any

from typer import Option

from scex_sumo.commands.options import Result
from scex_sumo.errors import UsageError


def encounters_command(
    folder: Result,
    pair: Annotated[str | None, Option(metavar="A,B", help="Only these two vehicles, in full.")] = None,
    most: Annotated[int, Option(metavar="N", help="How many pairs are listed.")] = 20,
) -> None:
    """List which vehicles meet in a run, the most critical first."""
    from rich.console import Console

    from scex_sumo.reports.tables.encounters import print_encounters, print_pair
    from scex_sumo.results.run import open_run

    run = open_run(folder)
    console = Console(width=None if sys.stdout.isatty() else 110)
    if pair is None:
        print_encounters(run, console, most=most)
    else:
        print_pair(run, _row(run.encounters.to_pylist(), pair), console)


def _row(rows: list[dict[str, Any]], pair: str) -> Mapping[str, Any]:
    """The row of two vehicles, in whichever order they are named."""
    try:
        wanted = sorted(int(part) for part in pair.split(","))
    except ValueError:
        wanted = []
    if len(wanted) != 2:
        raise UsageError(f"--pair {pair}: needs two track ids, e.g. --pair 17,23")
    for row in rows:
        if sorted((row["track_id"], row["other_id"])) == wanted:
            return row
    raise UsageError(f"--pair {pair}: these two vehicles meet in no child of the run")
