"""``scex-sumo explain``: which vehicles' models make a run's values vary, and what makes them critical."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.console import progress_bar
from scex_sumo.commands.metrics import write_table
from scex_sumo.commands.options import Result, metric_option

if TYPE_CHECKING:
    from scex_sumo.results.run import Run
    from scex_sumo.studies.explain.effects import Effect
    from scex_sumo.studies.explain.explain import Explanation

_MIN_SHARE = 0.05  # of the variance, to be named
_SHOWN_DRIVERS = 3  # of more vehicles, those of the two concerned


EXAMPLE = "out/k733 --metric ttc"


def explain_command(
    folder: Result,
    metric: Annotated[str | None, metric_option("Print this one, with all its worst children.")] = None,
    encounter: Annotated[
        str | None, Option(metavar="A,B", help="Print whose models make these two collide.")
    ] = None,
    worst: Annotated[int, Option(metavar="N", help="How many of the worst children are named.")] = 5,
    plots: Annotated[
        bool, Option("--report/--no-report", "--plots/--no-plots", help="Write explain.html.")
    ] = True,
) -> None:
    """Say which vehicles' drivers make a scene critical, and how."""
    from scex_sumo.commands.console import output_console
    from scex_sumo.metrics.registry import COLLISION, COLUMNS, column_named
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run
    from scex_sumo.studies.explain.explain import (
        assignment_of,
        condition_rows,
        effect_rows,
        explain,
        metric_values,
        worst_rows,
    )

    if worst < 1:
        raise UsageError(f"--worst: got {worst}, needs at least 1")
    with as_written(folder):
        run = open_run(folder)
        if encounter is not None:
            metric_values(run, encounter)
        elif metric is not None:
            metric = column_named(metric, [*run.outcomes, *run.columns])
        metric = encounter or metric
        levels, names = assignment_of(run)
        ids = run.info["seed_scene"]["track_ids"]
        questions = [*run.outcomes, *run.columns, *([encounter] if encounter else [])]
        with progress_bar("explain") as tick:
            found = explain(run, questions, worst=worst, progress=tick)
        worst_of = {e.metric: worst_rows(run, e, levels, names) for e in found}
    _write(folder / "explain_effects.parquet", [r for e in found for r in effect_rows(e, ids)])
    _write(folder / "explain_conditions.parquet", [r for e in found for r in condition_rows(e, ids, names)])
    _write(folder / "explain_worst.parquet", [r for rows in worst_of.values() for r in rows])
    wanted = [COLLISION, *COLUMNS[::2], *run.thresholds] if metric is None else [metric]
    shown, console = [e for e in found if e.metric in wanted], output_console()
    for explanation in shown:
        worst_ones = worst_of[explanation.metric][: 1 if metric is None else None]
        for line in _told(run, explanation, ids, names, worst_ones):
            print_line(line, console)
    if not any(explanation.effects for explanation in shown):
        print("too few children, or values that do not vary: no shares; run with more --children")
    print(f"result: {folder / 'explain_effects.parquet'}, explain_conditions, explain_worst")
    if plots:
        from scex_sumo.studies.explain.page import write_explanations

        print(f"report: {write_explanations(run, found, names, worst_of)}")


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    import pyarrow as pa

    if rows:
        write_table(pa.Table.from_pylist(rows), path)
    else:
        path.unlink(missing_ok=True)


def _sources(explanation: Explanation, ids: Sequence[int]) -> str:
    """Vehicles whose models the values vary with, the largest shares of the variance first."""
    found = sorted((e for e in explanation.effects if e.share >= _MIN_SHARE), key=lambda e: -e.share)
    return ", ".join(f"{e.share:.1%} {_source(e, ids)}" for e in found)


def _source(effect: Effect, ids: Sequence[int]) -> str:
    if effect.kind == "rest":
        return "more together or random routes"
    first = str(ids[effect.vehicle])
    return f"{first} alone" if effect.kind == "main" else f"{first} with {ids[effect.other]}"


def _question(explanation: Explanation) -> str:
    """What is explained, in words."""
    from scex_sumo.metrics.registry import COLLISION, side_of
    from scex_sumo.studies.explain.explain import pair_of

    if explanation.metric == COLLISION:
        return "collision"
    if pair := pair_of(explanation.metric):
        return f"collision of {pair[0]} and {pair[1]}"
    sign = "<=" if side_of(explanation.metric) == "left" else ">="
    kind = "critical" if explanation.given else "worst tenth"
    return f"{explanation.metric} {kind} ({sign} {explanation.threshold:.3g})"


def _told(
    run: Run,
    explanation: Explanation,
    ids: Sequence[int],
    names: Sequence[str],
    worst: Sequence[dict[str, Any]],
) -> Iterator[str]:
    """Yield the lines that the terminal shows for one metric."""
    if explanation.defined == 0:
        yield f"{explanation.metric}: defined in no child"
        return
    p = explanation.p_critical
    sure = "" if p.low == p.high else f" (95 %: {p.low:.1%} – {p.high:.1%})"
    yield f"{_question(explanation)}: {p.value:.1%} of {p.count} children{sure}"
    for c in explanation.rules:
        who = " and ".join(f"{ids[v]}={names[m]}" for v, m in zip(c.vehicles, c.models, strict=True))
        sure = "" if c.low == c.high else f"95 %: {c.low:.0%} – {c.high:.0%}, "
        counted = f"{c.critical} of {c.children}; {c.covered:.0%} of the critical ones"
        yield f"  {c.share:.0%} with {who} ({sure}{counted})"
    if sources := _sources(explanation, ids):
        yield f"  variance: {sources}"
    for row in worst:
        value = [f"{row['value']:.3g}"] if explanation.metric in run.columns else []
        if row["track_id"] is not None:
            other = "" if row["other_id"] is None else f" with {row['other_id']}"
            value.append(f"{row['track_id']}{other} after {row['after_s']:.1f} s")
        if explanation.metric not in run.columns and not row["value"]:
            continue  # nobody collides
        drivers = row["assignment"].split()
        if len(drivers) > _SHOWN_DRIVERS:
            both = (f"{row['track_id']}=", f"{row['other_id']}=")
            drivers = [name for name in drivers if name.startswith(both)]
        yield f"  child {row['child']}: {', '.join(value)}: {' '.join(drivers)}"
