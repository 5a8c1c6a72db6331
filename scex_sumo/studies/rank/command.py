"""``scex-sumo rank``: rank the encounters of a dataset: which are worth testing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Every, OutFolder, Overwrite, Processes, Roots
from scex_sumo.commands.shared import Answer
from scex_sumo.studies.moments.command import Models, run_study

if TYPE_CHECKING:
    from scex_sumo.studies.rank.rank import Ranking

_SHOWN_FAILURES = 3
_COUNTS = (
    "{encounters} encounters in {seeds} seed scenes: {to_test} to be tested, {doubtful} with doubtful data "
    "(end of ranking.csv); {futures_run} futures"
)

EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm --every 5 -o out/ranking"


def rank_command(
    roots: Roots,
    every: Every = 1.0,
    first_s: Annotated[float | None, Option("--from", metavar="S", help="First moment, s.")] = None,
    last_s: Annotated[float | None, Option("--to", metavar="S", help="Last moment, s.")] = None,
    futures: Annotated[int, Option(help="Futures of each seed scene on the page.")] = 96,
    models: Models = None,
    top: Annotated[int, Option(help="Encounters on the page.")] = 10,
    by: Annotated[
        str, Option(metavar="COLUMN", help="Column by which encounters are ordered.")
    ] = "probability",
    triage: Annotated[
        Path | None, Option(metavar="CSV", help="Verdicts saved on the page of a ranking.")
    ] = None,
    workers: Processes = "auto",
    overwrite: Overwrite = False,
    out: OutFolder = Path("out") / "ranking",
) -> Answer:
    """Rank the encounters of a dataset: which are worth testing."""
    options = {**locals()}
    from scex_sumo.drivers.registry import DEFAULT_MODELS
    from scex_sumo.studies.rank.rank import rank

    options["window"] = options.pop("first_s"), options.pop("last_s")
    options["models"] = DEFAULT_MODELS if models is None else models
    ranking = run_study(rank, "futures", **options)
    columns = (ranking.moments[name].to_pylist() for name in ("seed", "failure"))
    failed = [f"{name}: failed: {why}" for name, why in zip(*columns, strict=True) if why is not None]
    more = len(failed) - _SHOWN_FAILURES
    warn(failed[:_SHOWN_FAILURES] + ([f"{more} more failed; see moments.csv"] if more > 0 else []))
    _print_top(ranking, top)
    counts = {
        name: ranking.info[name] for name in ("seeds", "futures_run", "encounters", "doubtful", "to_test")
    }
    print(_COUNTS.format(**counts))
    print(f"result: {out / 'ranking.csv'}")
    print(f"look:   {out / 'ranking.html'}")
    return lambda: {
        "result": out / "ranking.csv",
        "report": out / "ranking.html",
        "notes": ranking.info["notes"],
        "scenes": ranking.info["seeds"],
        "futures": ranking.info["futures_run"],
        "shown": ranking.info["shown"],
        "encounters": ranking.table.to_pylist(),
        "moments": ranking.moments.to_pylist(),
    }


def _print_top(ranking: Ranking, top: int) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.columns import print_columns
    from scex_sumo.reports.console_table import print_line
    from scex_sumo.studies.rank.page import PRINTED_COLUMNS

    console, encounters = output_console(width=160), ranking.table.slice(0, top).to_pylist()
    encounters = [encounter for encounter in encounters if encounter["rank"] is not None]
    print_columns(PRINTED_COLUMNS, encounters, console, "encounters worth testing")
    about = "people: one of so many such moments ends in a contact within 3 s, and the range of that number"
    stress = "stress: share of the futures of the stress test in which they collide"
    print_line(f"{about}; {stress}", console)
