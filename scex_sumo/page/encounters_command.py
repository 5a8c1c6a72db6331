"""``scex-sumo encounters``: pairs of vehicles that meet in a run, how critically, and with which models."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.options import Result
from scex_sumo.commands.shared import Answer

EXAMPLE = "out/roundabout --pair 11,7"


def encounters_command(
    folder: Result,
    pair: Annotated[str | None, Option(metavar="A,B", help="Only these two vehicles, in full.")] = None,
) -> Answer:
    """List which vehicles meet in a run, the most critical first."""
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.report.encounter_table import print_encounters, print_pair
    from scex_sumo.reports.encounter_rows import meetings
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    console = output_console(width=110)
    with as_written(folder):
        run = open_run(folder)
        encounters = meetings(run)
        if pair is None:
            print_encounters(run, encounters, console)
        else:
            wanted = sorted(run.two_tracks(pair, "--pair"))
            encounters = [meeting for meeting in encounters if list(meeting.pair) == wanted]
            if not encounters:
                raise UsageError(f"--pair {pair}: these two vehicles meet in no future of the run")
            for meeting in encounters:
                print_pair(meeting, console)
        name, rows = run.info["seed_scene"]["name"], [meeting.named_row for meeting in encounters]
    return lambda: {"scene": name, "futures": run.futures, "encounters": rows}
