"""What the terminal says of a run."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.evaluation.encounters import ENCOUNTERS, in_words
from scex_sumo.extrapolation.fallbacks import fallback_lines
from scex_sumo.metrics.registry import COLLISION, critical_columns, metric_of, side_of
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Interval

WORST = 3
"""Encounters that are told in words."""

_LEAST = 12  # characters of a column that may take several lines


def print_summary(run: Run, console: Console) -> None:
    """Print the table, then the answer in words, and what the path-following driver planned instead."""
    print_table(summary_table(run), console, breaks=(" if", " likely", " possible"))
    for line in [*answer_lines(run), *fallback_lines(run.info.get("fallbacks", []))]:
        print_line(line, console)


def answer_lines(run: Run) -> list[str]:
    """How often two vehicles collide, who they are, and what is critical whoever drives."""
    both = (("possible", run, "any of the models"), ("likely", run.reference, "people were recorded"))
    lines = [
        f"{name}: a collision in {one.p_collision.percent} of children, driven as {how}"
        for name, one, how in both
        if one is not None and one.outcomes
    ]
    if always := always_critical(run):
        lines.append(f"critical in every child, whoever drives: {', '.join(always)}")
    if worst := worst_encounters(run):
        lines.append("worst encounters, who hits or follows → whom (how, where, after what time):")
    elif (run.folder / ENCOUNTERS).is_file():
        lines.append("no encounter of two vehicles is critical in any child")
    return lines + [f"  {in_words(row)}" for row in worst]


def worst_encounters(run: Run) -> list[dict[str, Any]]:
    """The most critical pairs of vehicles; none that is critical in no child."""
    rows = run.encounters.slice(0, WORST).to_pylist() if (run.folder / ENCOUNTERS).is_file() else []
    return [row for row in rows if row["critical"] > 0]


def print_line(text: str, console: Console) -> None:
    """Print a sentence, broken between words on a terminal and not at all elsewhere."""
    indent = len(text) - len(text.lstrip())
    wide = console.size.width if console.is_terminal else len(text) + 1
    told = textwrap.wrap(text, wide, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
    console.print(Text("\n".join(told)), soft_wrap=True)


def always_critical(run: Run) -> list[str]:
    """Printed names of the metrics that are critical in every child, the likely ones too."""
    columns = [c for c in critical_columns(run.columns) if c in run.thresholds]
    both = [one for one in (run, run.reference) if one is not None]
    return [metric_of(c).words for c in columns if all(one.p_critical(c).value == 1.0 for one in both)]


def print_table(table: Table, console: Console, *, breaks: Sequence[str] = ()) -> None:
    """Print a table, without its frame where the terminal is too narrow, and never cut off.

    Args:
        table: columns with overflow ``fold`` may take several lines, all others take one.
        console: where to; it gets as wide as the table needs.
        breaks: parts of headers that begin a new line where the terminal is too narrow.
    """
    unlimited = console.options.update(max_width=1000)
    if console.measure(table, options=unlimited).maximum > console.width:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        for column in table.columns:
            for part in breaks:
                column.header = str(column.header).replace(part, f"\n{part.strip()}")
        folded = [c for c in table.columns if c.overflow == "fold"]
        spare = sum(max(0, *(cell_len(str(cell)) for cell in c.cells)) - _LEAST for c in folded)
        needed = console.measure(table, options=unlimited).maximum
        console.width = max(console.width, needed - max(0, spare))
    console.print(table)


def summary_table(run: Run) -> Table:
    """Per metric: recorded value, median of the children, share of critical children, defined children."""
    import numpy as np

    scene = run.info["seed_scene"]
    table = Table(
        title=f"{scene['name']}: {counted(scene['vehicles'], 'vehicle')}, "
        f"{counted(run.children, 'child scenario')}",
        title_justify="left",
        caption=f"median: of each child's worst value; {_interval_of(run)}",
        caption_justify="left",
    )
    table.add_column("metric")
    likely = run.reference
    possible = "P(critical)" if likely is None else "P possible"
    for name in ("recorded", "median", "critical if", *_beside(likely, "P likely"), possible):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("95 %", "defined"):
        table.add_column(name, justify="right", no_wrap=True)
    if COLLISION in run.metrics.column_names:
        share = run.p_collision
        table.add_row(
            "collision",
            _recorded_overlaps(run),
            "–",
            "any",
            *_beside(likely, f"{likely.p_collision.value:.1%}" if likely else ""),
            *_shares(share),
            f"{run.children}/{run.children}",
        )
    for column in critical_columns(run.columns):
        samples = run.samples(column)
        recorded = run.recorded_value(column)
        threshold = run.thresholds.get(column)
        table.add_row(
            Text(metric_of(column).titled()),  # or rich takes the unit in brackets for markup
            _number(recorded),
            _number(float(np.median(samples)) if len(samples) else None),
            *_critical(run, column, threshold, likely),
            f"{len(samples)}/{run.children}",
        )
    return table


def _interval_of(run: Run) -> str:
    """What the interval of a share is."""
    if run.intervals.whole:
        return "the children are all assignments: only routes are drawn"
    return "95 %: interval of the P before it, in %"


def _beside(likely: Run | None, cell: str) -> tuple[str, ...]:
    """A cell of the column of what is likely, where a run has that."""
    return () if likely is None else (cell,)


def _critical(run: Run, column: str, threshold: float | None, likely: Run | None) -> tuple[str, ...]:
    if threshold is None:
        return "–", *_beside(likely, "–"), "–", "–"
    sign = "≤" if side_of(column) == "left" else "≥"
    share = _beside(likely, f"{likely.p_critical(column).value:.1%}" if likely else "")
    return f"{sign} {threshold:.3g}", *share, *_shares(run.p_critical(column))


def _shares(share: Interval) -> tuple[str, str]:
    known = share.low == share.high
    return f"{share.value:.1%}", "–" if known else f"{100 * share.low:.1f}–{100 * share.high:.1f}"


def _recorded_overlaps(run: Run) -> str:
    """Recorded boxes that overlap are no collisions; how many pairs there are is said in their place."""
    known = run.info.get("recorded")
    if known is not None and not known["overlaps"]:
        return "none"
    return "–" if known is None else counted(len(known["overlaps"]), "overlap")


def counted(count: int, noun: str) -> str:
    """A number with its noun, in the plural where it is one."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
