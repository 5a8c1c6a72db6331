"""``scex-sumo rank``: rank the moments of a dataset by how critical they can become."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.console import run_study, warn
from scex_sumo.commands.options import (
    Cache,
    Cluster,
    Every,
    Metrics,
    MinVehicles,
    Models,
    Preset,
    Processes,
    Roots,
    Seed,
    Thresholds,
)
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.studies.rank.rank import Ranking

_SHOWN_FAILURES = 3


EXAMPLE = "recordings/ --every 1 --workers 8 -o out/ranking"


def rank_command(
    roots: Roots,
    every: Every = 1.0,
    first_s: Annotated[float | None, Option("--from", metavar="S", help="First moment, s.")] = None,
    last_s: Annotated[float | None, Option("--to", metavar="S", help="Last moment, s.")] = None,
    futures: Annotated[int, Option(help="Largest number of futures of a seed scene.")] = 96,
    first: Annotated[int, Option(help="Futures of every seed scene; close ranks get more.")] = 32,
    min_vehicles: MinVehicles = 2,
    models: Models = None,
    preset: Preset = "both",
    metrics: Metrics = None,
    threshold: Thresholds = None,
    keep: Annotated[str, Option(metavar="none|critical|all", help="Futures whose tracks are kept.")] = "none",
    top: Annotated[int, Option(help="Moments on the page.")] = 10,
    by: Annotated[
        str, Option(metavar="mixed|severity|collisions|encounters", help="Order of the moments.")
    ] = "mixed",
    exact: Annotated[bool, Option(help="Exact P where it saves futures.")] = True,
    seed: Seed = 0,
    workers: Processes = 1,
    cluster: Cluster = None,
    cache: Cache = True,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace another ranking.")] = False,
    out: Annotated[
        Path, Option("-o", "--out", metavar="OUT", help="Folder; else out/ranking.", show_default=False)
    ] = Path("out") / "ranking",
) -> Answer:
    """Rank the moments of a dataset: which are worth testing."""
    options = {**locals()}
    from scex_sumo.behaviors.registry import DEFAULT_MODELS
    from scex_sumo.extrapolation.settings import read_thresholds
    from scex_sumo.studies.rank.rank import rank

    options["window"] = options.pop("first_s"), options.pop("last_s")
    options["thresholds"] = read_thresholds(options.pop("threshold") or ())
    options["models"] = DEFAULT_MODELS if models is None else models
    options["metrics"] = None if metrics is None else [name.strip() for name in metrics.split(",")]
    ranking = run_study(rank, "futures", **options)
    fallbacks = ranking.info["fallbacks"]
    about = "plans were replaced by the path-following driver's; see column fallbacks of ranking.csv"
    warn([f"{fallbacks} {about}"] if fallbacks else [])
    rows = ranking.table.select(["seed", "failure"]).to_pylist()
    failed = [f"{row['seed']}: failed: {row['failure']}" for row in rows if row["failure"] is not None]
    more = len(failed) - _SHOWN_FAILURES
    warn(failed[:_SHOWN_FAILURES] + ([f"{more} more failed; see ranking.csv"] if more > 0 else []))
    _print_top(ranking)
    print(f"{ranking.info['seeds']} seed scenes, {ranking.info['futures_run']} futures")
    print(f"result: {out / 'ranking.csv'}")
    print(f"look:   {out / 'ranking.html'}")
    return lambda: {
        "result": out / "ranking.csv",
        "report": out / "ranking.html",
        "notes": ranking.info["notes"],
        "scenes": ranking.info["seeds"],
        "futures": ranking.info["futures_run"],
        "shown": ranking.info["shown"],
        "moments": ranking.table.to_pylist(),
    }


def _print_top(ranking: Ranking) -> None:
    from pyarrow import array, string
    from pyarrow.compute import is_in

    from scex_sumo.commands.console import output_console
    from scex_sumo.page.study import print_columns
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.studies.rank.table import printed_columns

    shown = is_in(ranking.table["seed"], array(ranking.info["shown"], string()))
    console, rows = output_console(width=160), ranking.table.filter(shown).to_pylist()
    print_columns(printed_columns(), rows, console, "most critical moments, at least 3 s apart")
    about = "P(collision): stress test; encounters: critical ones of a future"
    order = ranking.info.get("by", "collisions, how hard they are, and these")
    print_line(f"{about} on average; ranked by {order}", console)
    least = max((row["remainder"] for row in rows if row["remainder"] is not None), default=None)
    if least is not None:
        print_line(f"exact: its tables are wrong in at most {least:.1%} of the assignments (95 %)", console)
