"""Details of a run in the terminal: the table of metrics and the stress test in words."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.base.errors import listed
from scex_sumo.metrics.registry import PAPER_METRICS, critical_columns
from scex_sumo.reports.encounter_rows import (
    STRESS_TEST,
    Meeting,
    driven_as,
    grouped,
    meetings,
    sentence,
    worst_of,
    worst_stress,
)
from scex_sumo.results.design import is_critical
from scex_sumo.results.folder import horizons_of
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Interval

SEVERITY: Final = "severe injuries [‰]"
MAIN: Final[tuple[str, ...]] = ("gap", "ttc_path", "drac", "thw", "wttc_path")
"""Metrics of the table in its default form."""

Head: TypeAlias = tuple[str, str, str]
"""Title, format and hint of a column in the terminal and on a page.

Formats: text, names and words (left-aligned), real, percent, seconds, metres; in a terminal also ``.2f``.
"""
_FORMS = {"real": "{:.2f}", "percent": "{:.1%}", "seconds": "{:.1f} s", "metres": "{:.1f} m"}

_WORST = 3  # lines of encounters
_ALWAYS = 0.95  # share from which a metric tells no futures apart
_MIN_FOLDED = 12  # characters of a folded column


def print_details(run: Run, console: Console, *, every: bool = False) -> None:
    """Print the table of metrics and the stress test in words.

    Args:
        every: all metrics, not the main ones alone.
    """
    print_table(summary_table(run, every=every), console, breaks=(" if", "-like", " test"))
    for line in stress_lines(run):
        print_line(line, console)


def stress_lines(run: Run) -> list[str]:
    """Return the stress test: share of collisions and the worst encounters in words."""
    worst = grouped(worst_stress(run))[:_WORST]
    which = "other " if run.baseline is not None else ""
    listed_below = "a vehicle hits or follows → another (how, where, after what time):"
    none = f"no {which}encounter of two vehicles is critical in any future"
    head = f"{STRESS_TEST}: {_collides(run)}; {listed_below if worst else none}"
    return [head, *(f"  {sentence(group)}" for group in worst), *_left_out(meetings(run))]


def _collides(run: Run) -> str:
    return f"a collision in {run.collision.percent} of futures, driven as {driven_as(run)}"


def _left_out(encounters: list[Meeting]) -> list[str]:
    """Return which critical pairs are left out of the lists, and why."""
    doubts = dict.fromkeys(meeting.doubt for meeting in worst_of(encounters, doubtful=True) if meeting.doubt)
    return [f"left out as doubtful: {listed(doubts)}"] if doubts else []


def expected_injuries(run: Run) -> float:
    """Return the expected number of severe injuries (MAIS 3+) in a future."""
    return float(np.sum(np.asarray(run.encounters["expected_mais3"])))


def print_line(text: str, console: Console) -> None:
    """Print a sentence; only terminals break it, between words."""
    indent = len(text) - len(text.lstrip())
    wide = console.size.width if console.is_terminal else len(text) + 1
    wrapped = textwrap.wrap(text, wide, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
    console.print(Text("\n".join(wrapped)), soft_wrap=True)


def always_critical(run: Run) -> list[str]:
    """Return columns that are critical in nearly all futures of both sets and in the recording."""
    both = [one for one in (run, run.reference) if one is not None]
    columns = []
    for column, limit in run.thresholds.items():
        recorded = run.recorded_value(column) if column in run.columns else None
        is_so = recorded is None or bool(is_critical(np.array([recorded]), run.metric(column), limit)[0])
        if column in run.columns and is_so and all(one.p_critical(column).value >= _ALWAYS for one in both):
            columns.append(column)
    return columns


def console_table(
    title: str, heads: Sequence[Head], rows: Iterable[Sequence[Any] | None], *, caption: str | None = None
) -> Table:
    """Return a table for the terminal; None and NaN are dashes, and a column of words may fold.

    A row None begins a section.
    """
    table = Table(title=title, title_justify="left", caption=caption, caption_justify="left")
    for name, form, _ in heads:
        left, words = form in ("names", "words"), form == "words"
        style: dict[str, Any] = {"overflow": "fold"} if words else {"no_wrap": True}
        table.add_column(Text(name), justify="left" if left else "right", **style)
    forms = [f"{{:{form}}}" if form[:1] == "." else _FORMS.get(form, "{}") for _, form, _ in heads]
    for row in rows:
        if row is None:
            table.add_section()
        else:
            cells = zip(forms, row, strict=True)
            table.add_row(*(Text("–" if c is None or c != c else form.format(c)) for form, c in cells))
    return table


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


def summary_table(run: Run, *, every: bool = False) -> Table:
    """Return recorded value, median, critical share and number of defined futures by metric."""
    scene, likely = run.info["seed_scene"], run.reference
    title = f"{scene['name']}: {participants(scene)}, {counted(run.futures, 'future')}"
    if likely is not None:
        title += f", {likely.futures} human-like ones"
    if region := run.info.get("region"):
        inside = counted(len(region["vehicles"]), "vehicle")
        title += f"\nonly pairs with one of {inside} {region['words']}"
    shares = ("P(critical)",) if likely is None else ("human-like", "stress test")
    heads = ("recorded", "median", "critical if", *shares, "95 %", "defined")
    rows: list[Sequence[str] | None] = []
    human = () if likely is None else (_tight(likely.collision.share),)
    rows.append(("collision", _recorded_overlaps(run), "–", "any", *human, *_shares(run.collision), "all"))
    for seconds in horizons_of(int(run.info.get("steps", 0))):
        human = () if likely is None else (_tight(likely.p_collision_by(seconds).share),)
        collided = _shares(run.p_collision_by(seconds))
        rows.append((f"collision by {seconds:g} s", *("–",) * 2, "any", *human, *collided, "all"))
    human = () if likely is None else (f"{1000 * expected_injuries(likely):.2f}",)
    rows.append((SEVERITY, *("–",) * 3, *human, f"{1000 * expected_injuries(run):.2f}", "–", "all"))
    for name, values in extra_rows(run).items():
        cells = [row_cell(value) for value in values]
        rows.append((name, *("–",) * 3, *([] if likely is None else cells[1:]), cells[0], "–", "all"))
    for part in shown_columns(run, every=every):
        rows.append(None)
        for column in part:
            recorded = run.recorded_value(column)
            rows.append(
                (
                    run.metric(column).titled(),
                    _number(recorded if recorded is None or np.isfinite(recorded) else None),
                    _median(run, column),
                    *_critical(run, column, likely),
                    _defined(run, column, likely),
                )
            )
    caption = f"median: of each future's worst value; {_interval_of(run)}"
    named: list[Head] = [("metric", "names", ""), *((head, "text", "") for head in heads)]
    return console_table(title, named, rows, caption=caption)


def row_cell(value: float | str | None) -> str:
    """Return the value of a row of an extra as it is printed."""
    return value if isinstance(value, str) else "–" if value is None else f"{value:.3g}"


def extra_rows(run: Run) -> dict[str, list[float | str | None]]:
    """Return the rows of the extras by title: the value in the stress test, then in the reference."""
    sets = [run] if run.reference is None else [run, run.reference]
    rows_of = [{row["name"]: row for row in one.info.get("rows", ())} for one in sets]
    titles = {name: f" [{row['unit']}]" if row["unit"] else "" for name, row in rows_of[0].items()}
    return {
        f"{name}{unit}": [rows.get(name, {}).get("value") for rows in rows_of]
        for name, unit in titles.items()
    }


def shown_columns(run: Run, *, every: bool) -> tuple[list[str], list[str]]:
    """Return the metrics of the table, and the paper's six below them.

    Without ``every``, those that are critical in nearly all futures are left out.
    """
    columns = critical_columns(run.columns)
    if not every:
        always = always_critical(run)
        columns = [column for column in columns if column not in always]
        if set(MAIN) <= set(run.columns) and not run.info.get("metrics"):
            return [column for column in MAIN if column in columns], []
    main = [column for column in MAIN if column in columns]
    main += [column for column in columns if column not in (*main, *PAPER_METRICS)]
    return main, [column for column in columns if column in PAPER_METRICS]


def _interval_of(run: Run) -> str:
    if run.intervals.whole:
        return "the futures are all assignments: only routes are drawn"
    return "95 %: confidence interval of the stress test"


def _critical(run: Run, column: str, likely: Run | None) -> tuple[str, ...]:
    """Return threshold, human-like share, share and interval; dashes where nothing is defined."""
    threshold = run.thresholds.get(column)
    if threshold is None:
        return ("–",) * (3 if likely is None else 4)
    known = likely is not None and len(likely.samples(column)) > 0
    human = _tight(likely.p_critical(column).share) if likely is not None and known else "–"
    shares = _shares(run.p_critical(column)) if len(run.samples(column)) else ("–", "–")
    return f"{run.metric(column).sign} {threshold:.3g}", *(() if likely is None else (human,)), *shares


def _median(run: Run, column: str) -> str:
    """Return the median; ``collides`` where it is 0 or infinite because most futures collide."""
    samples = run.samples(column)
    median = float(np.median(samples)) if len(samples) else None
    extreme = median is not None and (median == 0 or np.isinf(median))
    return "collides" if extreme and run.collision.value >= 0.5 else _number(median)


def _defined(run: Run, column: str, likely: Run | None) -> str:
    """Return in how many futures of each set a metric is defined."""
    counts = [(len(one.samples(column)), one.futures) for one in (run, likely) if one is not None]
    return "all" if all(n == of for n, of in counts) else "\n".join(f"{n}/{of}" for n, of in counts)


def _shares(share: Interval) -> tuple[str, str]:
    return _tight(share.share), "–" if share.low == share.high else share.range


def _tight(percent: str) -> str:
    return percent.replace(" ", "")


def _recorded_overlaps(run: Run) -> str:
    """Return the number of overlapping recorded boxes: measurement noise, not collisions."""
    recorded = run.info.get("recorded")
    if recorded is None:
        return "–"
    if recorded["overlaps"]:
        return counted(len(recorded["overlaps"]), "overlap")
    touch = "drac" in run.columns and np.isinf(run.recorded_value("drac") or 0.0)
    return "contact" if touch else "none"


def participants(scene: Mapping[str, Any]) -> str:
    """Return how many vehicles and people of a seed scene, as ``run.json`` has it, take part, and how."""
    people = len(scene.get("people", ()))
    words = counted(scene["vehicles"] - people, "vehicle")
    words += f" and {people} {'person' if people == 1 else 'people'}" if people else ""
    replayed = [counted(count, kind) for kind, count in (scene.get("replayed") or {}).items()]
    return f"{words} ({', '.join(replayed)} as recorded)" if replayed else words


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, e.g. ``2 vehicles``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _number(value: float | None) -> str:
    return "–" if value is None else "∞" if np.isinf(value) else f"{value:.2f}"
