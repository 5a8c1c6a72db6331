"""``scex-sumo encounters``: pairs of vehicles that meet in a run, how critically, and with which models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import numbers_by_name
from scex_sumo.commands.options import Around, InRegion, Result, two_tracks
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.reports.encounter_rows import Meeting
    from scex_sumo.results.run import Run

EXAMPLE = "out/k733 --pair 17,23"


def encounters_command(
    folder: Result,
    pair: Annotated[str | None, Option(metavar="A,B", help="Only these two vehicles, in full.")] = None,
    most: Annotated[int, Option(metavar="N", help="How many pairs are listed.")] = 20,
    weights: Annotated[
        str | None,
        Option(metavar="MODEL=W,...|recording", help="P with other weights."),
    ] = None,
    region: InRegion = None,
    around: Around = None,
) -> Answer:
    """List which vehicles meet in a run, the most critical first."""
    from scex_sumo.certainty.weights import print_weights, weighted_rows
    from scex_sumo.commands.answers import meeting_rows
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.report.encounter_table import print_encounters, print_pair
    from scex_sumo.reports.encounter_rows import meetings
    from scex_sumo.results.info import as_written
    from scex_sumo.results.region import region_of
    from scex_sumo.results.run import open_run

    console = output_console(width=110)
    asked, fit = None, weights == "recording"
    if weights is not None and not fit:
        form = "MODEL=WEIGHT, e.g. standard_driver=0.9"
        asked = numbers_by_name("--weights", weights.split(","), form)
    with as_written(folder):
        run = open_run(folder)
        if fit:
            from scex_sumo.certainty.fitted import fitted_weights, write_fitted
            from scex_sumo.reports.run_table import print_line

            fitted = fitted_weights(run)
            write_fitted(run.folder, fitted)
            asked = fitted.weights
            print_line(f"weights fitted to the recording: {fitted.words}", console)
        part = region_of(region, around)
        encounters = meetings(run, part)
        if asked is not None:
            print_weights(run, asked, console, most=most)
        elif pair is None:
            print_encounters(run, console, most=most, region=part)
        else:
            encounters = _meetings(run, pair)
            for meeting in encounters:
                print_pair(meeting, console)
        name = run.info["seed_scene"]["name"]
        rows = meeting_rows(encounters[:most])
        if asked is not None:
            rows = weighted_rows(run, encounters[:most], rows, asked)
    return lambda: {"scene": name, "futures": run.futures, "encounters": rows}


def _meetings(run: Run, pair: str) -> list[Meeting]:
    from scex_sumo.reports.encounter_rows import meetings

    wanted = sorted(two_tracks(pair, "--pair"))
    of_pair = [meeting for meeting in meetings(run) if list(meeting.pair) == wanted]
    if not of_pair:
        raise UsageError(f"--pair {pair}: these two vehicles meet in no future of the run")
    return of_pair
