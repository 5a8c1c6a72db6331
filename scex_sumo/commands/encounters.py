"""``scex-sumo encounters``: pairs of vehicles that meet in a run, how critically, and with which models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.options import Result

EXAMPLE = "out/k733 --pair 17,23"


def encounters_command(
    folder: Result,
    pair: Annotated[str | None, Option(metavar="A,B", help="Only these two vehicles, in full.")] = None,
    most: Annotated[int, Option(metavar="N", help="How many pairs are listed.")] = 20,
    weights: Annotated[
        str | None, Option(metavar="MODEL=W,...", help="Exact P with other weights, without new futures.")
    ] = None,
) -> None:
    """List which vehicles meet in a run, the most critical first."""
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.encounter_table import print_encounters, print_pair, print_weights
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    console = output_console(width=110)
    with as_written(folder):
        run = open_run(folder)
        if weights is not None:
            print_weights(run, parse_weights(weights), console)
        elif pair is None:
            print_encounters(run, console, most=most)
        else:
            print_pair(run, _row(run.encounters.to_pylist(), pair), console)


def parse_weights(text: str) -> dict[str, float]:
    """Parse ``MODEL=W,...``.

    Raises:
        UsageError: an entry has another form.
    """
    found = {}
    for entry in text.split(","):
        model, _, weight = entry.strip().rpartition("=")
        try:
            found[model] = float(weight)
        except ValueError:
            model = ""
        if not model:
            raise UsageError(f"--weights {entry}: needs MODEL=WEIGHT, e.g. standard_driver=0.9")
    return found


def _row(rows: list[dict[str, Any]], pair: str) -> Mapping[str, Any]:
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
