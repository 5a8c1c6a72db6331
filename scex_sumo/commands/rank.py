"""``scex-sumo rank``: from a dataset to its moments worth testing."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scex_sumo.commands.console import progress_bar, warn

if TYPE_CHECKING:
    from scex_sumo.ranking.rank import Ranking

_SHOWN_FAILURES = 3


@dataclass(frozen=True, kw_only=True)
class RankRequest:
    """The options of ``scex-sumo rank`` as given; see its help."""

    roots: tuple[Path, ...]
    every: float
    children: int
    first: int
    min_vehicles: int
    models: str | None
    thresholds: tuple[str, ...]
    keep: str
    top: int
    seed: int
    workers: int
    cluster: str | None
    overwrite: bool
    out: Path | None


def rank_command(request: RankRequest) -> None:
    """Rank, print the top, say where the page is."""
    from scex_sumo.behaviors.registry import DEFAULT_MODELS
    from scex_sumo.commands.run import parse_thresholds
    from scex_sumo.ranking.rank import rank

    out = request.out if request.out is not None else Path("out") / "ranking"
    with progress_bar("children") as tick:
        try:
            ranking = rank(
                request.roots,
                out=out,
                every=request.every,
                children=request.children,
                first=request.first,
                min_vehicles=request.min_vehicles,
                models=request.models if request.models is not None else DEFAULT_MODELS,
                thresholds=parse_thresholds(request.thresholds),
                keep=request.keep,
                top=request.top,
                seed=request.seed,
                workers=request.workers,
                cluster=request.cluster,
                overwrite=request.overwrite,
                command=["scex-sumo", *sys.argv[1:]],
                progress=tick,
            )
        except KeyboardInterrupt:
            print(f"interrupted; finished seeds are kept in {out}, the same command goes on", file=sys.stderr)
            raise SystemExit(130) from None
    warn(ranking.info["notes"])
    if ranking.info["fallbacks"]:
        warn([f"{ranking.info['fallbacks']} plans are not the models' own; see column fallbacks"])
    _warn_failures(ranking)
    _print_top(ranking)
    print(f"{ranking.info['seeds']} seed scenes, {ranking.info['children_run']} children")
    print(f"result: {out / 'ranking.csv'}")
    print(f"look:   {out / 'ranking.html'}")


def _warn_failures(ranking: Ranking) -> None:
    rows = ranking.table.select(["seed", "failure"]).to_pylist()
    rows = [row for row in rows if row["failure"] is not None]
    warn(f"{row['seed']}: failed: {row['failure']}" for row in rows[:_SHOWN_FAILURES])
    if len(rows) > _SHOWN_FAILURES:
        warn([f"{len(rows) - _SHOWN_FAILURES} more failed; see ranking.csv"])


def _print_top(ranking: Ranking) -> None:
    """The moments on the page."""
    from pyarrow import array, string
    from pyarrow.compute import is_in
    from rich.console import Console
    from rich.table import Table

    from scex_sumo.reports.run_table import print_table

    table = Table(title="most critical moments, at least 3 s apart", title_justify="left")
    shares = list(ranking.info["thresholds"])
    shown = is_in(ranking.table["seed"], array(ranking.info["shown"], string()))
    for name in ("rank", "95 %", "seed", "vehicles", "children", *(f"P({c})" for c in shares)):
        if name == "seed":
            table.add_column(name, overflow="fold")
        else:
            table.add_column(name, justify="right", no_wrap=True)
    for row in ranking.table.filter(shown).to_pylist():
        values = [row[f"p_{column}"] for column in shares]
        table.add_row(
            str(row["rank"]),
            f"{row['rank_low']}–{row['rank_high']}",
            row["seed"],
            str(row["vehicles"]),
            str(row["children"]),
            *("–" if value is None else f"{value:.0%}" for value in values),
        )
    print_table(table, Console(width=None if sys.stdout.isatty() else 160))
