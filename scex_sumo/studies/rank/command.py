"""``scex-sumo rank``: rank the moments of a dataset by how critical they can become."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.commands.console import progress_bar, resumable, warn
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
    parse_thresholds,
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
    children: Annotated[int, Option(help="Largest number of futures of a seed scene.")] = 96,
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
    from scex_sumo.behaviors.registry import DEFAULT_MODELS
    from scex_sumo.studies.rank.rank import rank

    with progress_bar("futures") as tick, resumable("seeds", out):
        ranking = rank(
            roots,
            out=out,
            every=every,
            window=(first_s, last_s),
            children=children,
            first=first,
            min_vehicles=min_vehicles,
            models=models if models is not None else DEFAULT_MODELS,
            preset=preset,
            metrics=None if metrics is None else [name.strip() for name in metrics.split(",")],
            thresholds=parse_thresholds(threshold),
            keep=keep,
            cache=cache,
            top=top,
            by=by,
            seed=seed,
            workers=workers,
            cluster=cluster,
            overwrite=overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    warn(ranking.info["notes"])
    if ranking.info["fallbacks"]:
        warn(
            [
                f"{ranking.info['fallbacks']} plans were replaced by the path-following driver's; "
                "see column fallbacks of ranking.csv"
            ]
        )
    _warn_failures(ranking)
    _print_top(ranking)
    print(f"{ranking.info['seeds']} seed scenes, {ranking.info['children_run']} futures")
    print(f"result: {out / 'ranking.csv'}")
    print(f"look:   {out / 'ranking.html'}")
    return lambda: {
        "result": out / "ranking.csv",
        "report": out / "ranking.html",
        "notes": ranking.info["notes"],
        "scenes": ranking.info["seeds"],
        "futures": ranking.info["children_run"],
        "shown": ranking.info["shown"],
        "moments": ranking.table.to_pylist(),
    }


def _warn_failures(ranking: Ranking) -> None:
    rows = ranking.table.select(["seed", "failure"]).to_pylist()
    rows = [row for row in rows if row["failure"] is not None]
    warn(f"{row['seed']}: failed: {row['failure']}" for row in rows[:_SHOWN_FAILURES])
    if len(rows) > _SHOWN_FAILURES:
        warn([f"{len(rows) - _SHOWN_FAILURES} more failed; see ranking.csv"])


def _print_top(ranking: Ranking) -> None:
    from pyarrow import array, string
    from pyarrow.compute import is_in
    from rich.table import Table

    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import print_line, print_table

    table = Table(title="most critical moments, at least 3 s apart", title_justify="left")
    shown = is_in(ranking.table["seed"], array(ranking.info["shown"], string()))
    for name in ("rank", "95 %", "moment", "vehicles", "children", "P(collision)", "encounters", "worst"):
        if name in ("moment", "worst"):
            table.add_column(name, overflow="fold")
        else:
            table.add_column(name, justify="right", no_wrap=True)
    for row in ranking.table.filter(shown).to_pylist():
        table.add_row(
            str(row["rank"]),
            f"{row['rank_low']}–{row['rank_high']}",
            row["seed"],
            str(row["vehicles"]),
            str(row["children"]),
            "{:.0f}% [{:.0f}–{:.0f}]".format(
                *(100 * row[f"p_collision{end}"] for end in ("", "_low", "_high"))
            ),
            f"{row['encounters']:.2f}",
            _worst_pair(row),
        )
    console = output_console(width=160)
    print_table(table, console)
    about = "P(collision): stress test; encounters: critical ones of a future"
    order = (
        "collisions, how hard they are, and these" if ranking.info.get("by") is None else ranking.info["by"]
    )
    print_line(f"{about} on average; ranked by {order}", console)


def _worst_pair(row: Mapping[str, Any]) -> str:
    if row["worst_track_id"] is None:
        return "–"
    often = f"{row['worst_p_critical']:.0%} critical"
    if row["worst_p_collision"] > 0:
        often = f"{row['worst_p_collision']:.0%} collide"
    return f"{row['worst_track_id']}, {row['worst_other_id']}: {often}"
