"""``scex-sumo explain``: vehicles whose models make a run's values vary or critical."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.console import progress_bar
from scex_sumo.commands.options import Result, metric_option
from scex_sumo.commands.shared import Answer
from scex_sumo.commands.tables import write_table

if TYPE_CHECKING:
    from scex_sumo.certainty.tables import InfluenceTable
    from scex_sumo.results.run import Run
    from scex_sumo.studies.explain.effects import Effect
    from scex_sumo.studies.explain.explain import Explanation

_SHOWN_EFFECTS = 6
_SHOWN_DRIVERS = 3  # of more vehicles, those of the two concerned
EXAMPLE = "out/k733 --metric ttc"


def explain_command(
    folder: Result,
    metric: Annotated[
        str | None, metric_option("Print only this metric, with all its worst futures.")
    ] = None,
    encounter: Annotated[
        str | None, Option(metavar="A,B", help="Print which models make these two vehicles collide.")
    ] = None,
    worst: Annotated[int, Option(metavar="N", help="Number of worst futures to name.")] = 5,
    plots: Annotated[
        bool, Option("--report/--no-report", "--plots/--no-plots", help="Write explain.html.")
    ] = True,
) -> Answer:
    """Find the vehicles and models that make a scene critical."""
    from scex_sumo.commands.answers import interval
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
    from scex_sumo.studies.explain.page import write_explanations

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
            explanations = explain(run, questions, worst=worst, progress=tick)
        worst_of = {e.metric: worst_rows(run, e, levels, names) for e in explanations}
        _write(folder / "explain_effects.parquet", [r for e in explanations for r in effect_rows(e, ids)])
        _write(
            folder / "explain_conditions.parquet",
            [r for e in explanations for r in condition_rows(e, ids, names)],
        )
        _write(folder / "explain_worst.parquet", [r for rows in worst_of.values() for r in rows])
        page = write_explanations(run, explanations, names, worst_of) if plots else None
        wanted = [COLLISION, *COLUMNS[::2], *run.thresholds] if metric is None else [metric]
        shown, console = [e for e in explanations if e.metric in wanted], output_console()
        always = [e for e in shown if e.always and metric is None]
        for explanation in (e for e in shown if e not in always):
            worst_ones = worst_of[explanation.metric][: 1 if metric is None else None]
            for line in _told(run, explanation, ids, names, worst_ones):
                print_line(line, console)
        if always:
            print_line(
                f"critical in every future: {', '.join(e.question(e.metric) for e in always)}", console
            )
    if not any(explanation.effects for explanation in shown):
        print("too few futures, or values that do not vary: no shares; run with more --futures")
    print(f"result: {folder / 'explain_effects.parquet'}, explain_conditions, explain_worst")
    if page is not None:
        print(f"report: {page}")

    def answer() -> dict[str, Any]:
        return {"scene": run.info["seed_scene"]["name"], "futures": run.futures} | {
            "explanations": [
                {
                    "metric": e.metric,
                    "question": e.question(e.metric),
                    "defined": e.defined,
                    "threshold": e.threshold,
                    "p_critical": interval(e.p_critical.estimate),
                    "effects": effect_rows(e, ids),
                    "rules": condition_rows(replace(e, conditions=e.rules), ids, names),
                    "worst": worst_of[e.metric],
                }
                for e in shown
            ]
        }

    return answer


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    import pyarrow as pa

    if rows:
        write_table(pa.Table.from_pylist(rows), path)
    else:
        path.unlink(missing_ok=True)


def _sources(effects: Sequence[Effect], ids: Sequence[int]) -> str:
    parts = sorted((e for e in effects if e.kind != "rest"), key=lambda e: -e.share)
    named, small = parts[:_SHOWN_EFFECTS], parts[_SHOWN_EFFECTS:]
    words = [
        f"{e.share:.1%} {ids[e.vehicle]}" + (" alone" if e.other < 0 else f" with {ids[e.other]}")
        for e in named
    ]
    if small:
        words.append(f"{sum(e.share for e in small):.1%} {len(small)} smaller ones")
    return ", ".join([*words, f"{effects[-1].share:.1%} not explained"])


def _exact_table(run: Run, metric: str) -> InfluenceTable | None:
    """Return the influence table of two vehicles' collision; None for other metrics."""
    from scex_sumo.certainty.results import exact_of
    from scex_sumo.studies.explain.explain import pair_of

    pair = pair_of(metric)
    exact = exact_of(run)
    return exact.table(*pair) if exact is not None and pair is not None else None


def _told(
    run: Run,
    explanation: Explanation,
    ids: Sequence[int],
    names: Sequence[str],
    worst: Sequence[dict[str, Any]],
) -> Iterator[str]:
    from scex_sumo.studies.explain.explain import undefined

    if explanation.defined == 0:
        yield f"{explanation.metric}: {undefined(explanation)}"
        return
    p, whole = explanation.p_critical, run.intervals.whole
    checked = "" if p.known is None else f"; {p.known.checked}"
    yield f"{explanation.question(explanation.metric)}: {p.percent} of {run.futures} futures{checked}"
    table = _exact_table(run, explanation.metric)
    if table is not None:
        yield "  exactly if:"
        yield from (f"    {words}" for words in table.in_words())
    for c in explanation.rules if table is None else ():
        models = " and ".join(f"{ids[v]}={names[m]}" for v, m in zip(c.vehicles, c.models, strict=True))
        sure = "" if whole else f"95 %: {c.low:.0%} – {c.high:.0%}, "
        counted = f"{sure}{c.critical} of {c.futures}), {c.covered:.0%} of the critical ones"
        yield f"  {c.share:.0%} of the futures with {models} ({counted}"
    if explanation.effects and table is None:
        yield f"  its variance over the futures is due to the models of: {_sources(explanation.effects, ids)}"
    for row in worst:
        value = [f"{row['value']:.3g}"] if explanation.metric in run.columns else []
        if row["track_id"] is not None:
            other = "" if row["other_id"] is None else f" with {row['other_id']}"
            value.append(f"{row['track_id']}{other} after {row['after_s']:.1f} s")
        if explanation.metric not in run.columns and not row["value"]:
            continue  # no collision
        drivers = row["assignment"].split()
        if len(drivers) > _SHOWN_DRIVERS:
            both = (f"{row['track_id']}=", f"{row['other_id']}=")
            drivers = [name for name in drivers if name.startswith(both)]
        yield f"  future {row['future']}: {', '.join(value)}: {' '.join(drivers)}"
