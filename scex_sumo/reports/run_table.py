"""Terminal summary of a run: table and answer in words."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.evaluation.encounters import ENCOUNTERS, in_words
from scex_sumo.extrapolation.fallbacks import fallback_lines
from scex_sumo.metrics.registry import COLLISION, critical_columns, metric_of, side_of
from scex_sumo.results.exact import CollisionShare
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Interval

_WORST = 3  # encounters in words
_MIN_FOLDED = 12  # characters of a folded column


def print_summary(run: Run, console: Console) -> None:
    """Print the table, the answer, and how often a fallback planned."""
    print_table(summary_table(run), console, breaks=(" if", "-like", " test"))
    for line in [*answer_lines(run), *fallback_lines(run.info.get("fallbacks", []))]:
        print_line(line, console)


def answer_lines(run: Run) -> list[str]:
    """Return collision shares, always critical metrics and the worst encounters in words."""
    both = (("stress test", run, "any of the models"), ("human-like", run.reference, "people were recorded"))
    lines = [
        f"{name}: a collision in {one.p_collision.percent} of futures, driven as {how}{_sure(one)}"
        for name, one, how in both
        if one is not None and one.outcomes
    ]
    if always := always_critical(run):
        lines.append(f"critical in every future, with any driver: {', '.join(always)}")
    if worst := worst_encounters(run):
        lines.append("worst encounters, a vehicle hits or follows → another (how, where, after what time):")
    elif (run.folder / ENCOUNTERS).is_file():
        lines.append("no encounter of two vehicles is critical in any future")
    return lines + [f"  {encounter_in_words(run, row)}" for row in worst]


def _sure(run: Run) -> str:
    share = run.p_collision
    return f"; {share.tables.told()}" if share.tables is not None and share.exact is not None else ""


def encounter_in_words(run: Run, row: Mapping[str, Any]) -> str:
    """Return an encounter in words, with its cut sets where the run has an exact table."""
    exact = run.exact
    return in_words(row, None if exact is None else exact.table(row["track_id"], row["other_id"]))


def expected_injuries(run: Run) -> float | None:
    """Return the expected number of severe injuries (MAIS 3+) in a future; None in older results."""
    there = (run.folder / ENCOUNTERS).is_file() and "expected_mais3" in run.encounters.column_names
    return float(np.sum(np.asarray(run.encounters["expected_mais3"]))) if there else None


def worst_encounters(run: Run) -> list[dict[str, Any]]:
    """Return the most critical pairs that are critical in some child."""
    rows = run.encounters.slice(0, _WORST).to_pylist() if (run.folder / ENCOUNTERS).is_file() else []
    return [row for row in rows if row["critical"] > 0]


def print_line(text: str, console: Console) -> None:
    """Print a sentence; only terminals break it, between words."""
    indent = len(text) - len(text.lstrip())
    wide = console.size.width if console.is_terminal else len(text) + 1
    told = textwrap.wrap(text, wide, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
    console.print(Text("\n".join(told)), soft_wrap=True)


def always_critical(run: Run) -> list[str]:
    """Return names of metrics that are critical in every child, also in the human-like ones."""
    columns = [c for c in critical_columns(run.columns) if c in run.thresholds]
    both = [one for one in (run, run.reference) if one is not None]
    return [metric_of(c).words for c in columns if all(one.p_critical(c).value == 1.0 for one in both)]


def print_table(table: Table, console: Console, *, breaks: Sequence[str] = ()) -> None:
    """Print a table; a narrow terminal gets no frame, and no cell is cut off.

    Args:
        table: only columns with overflow ``fold`` may take several lines.
        console: becomes as wide as the table needs.
        breaks: parts of headers that begin a new line on a narrow terminal.
    """
    unlimited = console.options.update(max_width=1000)
    if console.measure(table, options=unlimited).maximum > console.width:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        for column in table.columns:
            for part in breaks:
                column.header = str(column.header).replace(part, f"\n{part.strip()}")
        folded = [c for c in table.columns if c.overflow == "fold"]
        spare = sum(max(0, *(cell_len(str(cell)) for cell in c.cells)) - _MIN_FOLDED for c in folded)
        needed = console.measure(table, options=unlimited).maximum
        console.width = max(console.width, needed - max(0, spare))
    console.print(table)


def summary_table(run: Run) -> Table:
    """Return recorded value, median, critical share and number of defined futures by metric."""
    scene = run.info["seed_scene"]
    table = Table(
        title=f"{scene['name']}: {counted(scene['vehicles'], 'vehicle')}, {counted(run.children, 'future')}",
        title_justify="left",
        caption=f"median: of each future's worst value; {_interval_of(run)}",
        caption_justify="left",
    )
    table.add_column("metric")
    likely = run.reference
    possible = "P(critical)" if likely is None else "stress test"
    likely_head = () if likely is None else ("human-like",)
    for name in ("recorded", "median", "critical if", *likely_head, possible, "95 %", "defined"):
        table.add_column(name, justify="right", no_wrap=True)
    if COLLISION in run.metrics.column_names:
        table.add_row(
            "collision",
            _recorded_overlaps(run),
            "–",
            "any",
            *(() if likely is None else (f"{likely.p_collision.value:.1%}",)),
            *_collision_shares(run.p_collision),
            f"{run.children}/{run.children}",
        )
    if (injuries := expected_injuries(run)) is not None:
        human = None if likely is None else expected_injuries(likely)
        table.add_row(
            "severe injuries per 1000",
            *("–",) * 3,
            *(() if likely is None else ("–" if human is None else f"{1000 * human:.2f}",)),
            f"{1000 * injuries:.2f}",
            "–",
            f"{run.children}/{run.children}",
        )
    for column in critical_columns(run.columns):
        samples = run.samples(column)
        recorded = run.recorded_value(column)
        threshold = run.thresholds.get(column)
        table.add_row(
            Text(metric_of(column).titled()),  # not markup: the unit is in brackets
            _number(recorded),
            _number(float(np.median(samples)) if len(samples) else None),
            *_critical(run, column, threshold, likely),
            f"{len(samples)}/{run.children}",
        )
    return table


def _interval_of(run: Run) -> str:
    if run.intervals.whole:
        return "the futures are all assignments: only routes are drawn"
    return "95 %: confidence interval of the stress test"


def _critical(run: Run, column: str, threshold: float | None, likely: Run | None) -> tuple[str, ...]:
    if threshold is None:
        return ("–",) * (3 if likely is None else 4)
    sign = "≤" if side_of(column) == "left" else "≥"
    share = () if likely is None else (f"{likely.p_critical(column).value:.1%}",)
    return f"{sign} {threshold:.3g}", *share, *_shares(run.p_critical(column))


def _shares(share: Interval) -> tuple[str, str]:
    exact = share.low == share.high
    return f"{share.value:.1%}", "–" if exact else f"{100 * share.low:.1f}–{100 * share.high:.1f}"


def _collision_shares(share: CollisionShare) -> tuple[str, str]:
    return _shares(share) if share.exact is None else (f"{share.exact:.1%}", "exact")


def _recorded_overlaps(run: Run) -> str:
    """Return the number of overlapping recorded boxes: measurement noise, not collisions."""
    recorded = run.info.get("recorded")
    if recorded is None:
        return "–"
    return counted(len(recorded["overlaps"]), "overlap") if recorded["overlaps"] else "none"


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, e.g. ``2 vehicles``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
