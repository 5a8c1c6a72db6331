"""``scex-sumo encounters``: pairs of vehicles that meet in a run, how critically, and with which models."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.options import Result
from scex_sumo.commands.shared import Answer

EXAMPLE = "out/k733 --pair 17,23"


def encounters_command(
    folder: Result,
    pair: Annotated[str | None, Option(metavar="A,B", help="Only these two vehicles, in full.")] = None,
    most: Annotated[int, Option(metavar="N", help="How many pairs are listed.")] = 20,
) -> Answer:
    """List which vehicles meet in a run, the most critical first."""
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.encounter_table import print_encounters, print_pair
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    console = output_console(width=110)
    with as_written(folder):
        run = open_run(folder)
        rows = run.encounters.to_pylist()
        if pair is None:
            print_encounters(run, console, most=most)
        else:
            rows = [_row(rows, pair)]
            print_pair(run, rows[0], console)
    name = run.info["seed_scene"]["name"]
    return lambda: {"scene": name, "futures": run.children, "encounters": rows[:most]}


def _row(rows: list[dict[str, Any]], pair: str) -> dict[str, Any]:
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
