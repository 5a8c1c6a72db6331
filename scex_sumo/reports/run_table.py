"""Details of a run in the terminal: the table of metrics and the stress test in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from scex_sumo.base.errors import listed
from scex_sumo.metrics.registry import PAPER_METRICS, critical_columns
from scex_sumo.reports.console_table import console_table, print_line, print_table
from scex_sumo.reports.encounter_rows import STRESS_TEST, driven_as, meetings, worst_stress
from scex_sumo.reports.words import MAIN, Head, counted, extra_rows, participants, row_cell
from scex_sumo.results.folder import horizons_of
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Interval

SEVERITY: Final = "severe injuries [‰]"
_WORST = 3  # lines of encounters
_DASHES = ("–",) * 3


def print_details(run: Run, console: Console, *, every: bool = False) -> None:
    """Print the table of metrics, the main ones or every one, and the stress test in words."""
    print_table(summary_table(run, every=every), console, breaks=(" if", "-like", " test"))
    for line in stress_lines(run):
        print_line(line, console)


def stress_lines(run: Run) -> list[str]:
    """Return the stress test: share of collisions and the worst encounters in words."""
    worst = worst_stress(run)
    critical = (meeting for meeting in meetings(run) if meeting.row["critical"] > 0)
    doubts = dict.fromkeys(meeting.doubt for meeting in critical if meeting.doubt)
    which = "other " if run.baseline is not None else ""
    listed_below = "a vehicle hits or follows → another (how, where, after what time):"
    none = f"no {which}encounter of two vehicles is critical in any future"
    collides = f"a collision in {run.collision.percent} of futures, driven as {driven_as(run)}"
    head = f"{STRESS_TEST}: {collides}; {listed_below if worst else none}"
    left_out = [f"left out as doubtful: {listed(doubts)}"] if doubts else []
    return [head, *(f"  {meeting.words()}" for meeting in worst[:_WORST]), *left_out]


def expected_injuries(run: Run) -> float:
    """Return the expected number of severe injuries (MAIS 3+) in a future."""
    return float(np.sum(np.asarray(run.encounters["expected_mais3"])))


def summary_table(run: Run, *, every: bool = False) -> Table:
    """Return recorded value, median, critical share and number of defined futures by metric."""
    scene, likely = run.info["seed_scene"], run.reference
    title = f"{scene['name']}: {participants(scene)}, {counted(run.futures, 'future')}"
    title += "" if likely is None else f", {likely.futures} human-like ones"
    if region := run.info.get("region"):
        inside = counted(len(region["vehicles"]), "vehicle")
        title += f"\nonly pairs with one of {inside} {region['words']}"
    sets = [run] if likely is None else [likely, run]
    shares = ("P(critical)",) if likely is None else ("human-like", "stress test")
    heads = ("metric", "recorded", "median", "critical if", *shares, "95 %", "defined")
    rows: list[Sequence[str] | None] = []

    def add(name: str, cells: Callable[[Run], tuple[str, str]], *before: str, defined: str = "all") -> None:
        shares, intervals = zip(*map(cells, sets), strict=True)
        rows.append((name, *(before or _DASHES), *shares, intervals[-1], defined))

    add("collision", lambda result: _shares(result.collision), _recorded_overlaps(run), "–", "any")
    for until_s in horizons_of(int(run.info.get("steps", 0))):
        add(f"collision by {until_s:g} s", partial(_early, until_s=until_s), "–", "–", "any")
    add(SEVERITY, lambda result: (f"{1000 * expected_injuries(result):.2f}", "–"))
    for name, values in extra_rows(run).items():
        rows.append((name, *_DASHES, *map(row_cell, values[::-1]), "–", "all"))
    for group in shown_columns(run, every=every):
        rows.append(None)
        for column in group:
            threshold, recorded = run.thresholds.get(column), run.recorded_value(column)
            limit = "–" if threshold is None else f"{run.metric(column).sign} {threshold:.3g}"
            finite = recorded if recorded is None or np.isfinite(recorded) else None
            before = _number(finite), _median(run, column), limit
            name, critical = run.metric(column).titled(), partial(_critical, column=column)
            add(name, critical, *before, defined=_defined(sets[::-1], column))
    all_drawn = "the futures are all assignments: only routes are drawn"
    interval = all_drawn if run.intervals.whole else "95 %: confidence interval of the stress test"
    caption = f"median: of each future's worst value; {interval}"
    named: list[Head] = [(head, "text" if k else "names", "") for k, head in enumerate(heads)]
    return console_table(title, named, rows, caption=caption)


def shown_columns(run: Run, *, every: bool) -> tuple[list[str], list[str]]:
    """Return the metrics of the table, and with ``every`` the paper's six below them."""
    columns = critical_columns(run.columns)
    main = [column for column in MAIN if column in columns]
    if not every and len(main) == len(MAIN) and not run.info.get("metrics"):
        return main, []
    main += [column for column in columns if column not in (*main, *PAPER_METRICS)]
    return main, [column for column in columns if column in PAPER_METRICS]


def _early(run: Run, until_s: float) -> tuple[str, str]:
    return _shares(run.p_collision_by(until_s))


def _critical(run: Run, column: str) -> tuple[str, str]:
    """Return the critical share and its interval; dashes where nothing is defined."""
    if column not in run.thresholds or not len(run.samples(column)):
        return "–", "–"
    return _shares(run.p_critical(column))


def _median(run: Run, column: str) -> str:
    """Return the median; ``collides`` where it is 0 or infinite because most futures collide."""
    samples = run.samples(column)
    median = float(np.median(samples)) if len(samples) else None
    extreme = median is not None and (median == 0 or np.isinf(median))
    return "collides" if extreme and run.collision.value >= 0.5 else _number(median)


def _defined(sets: Sequence[Run], column: str) -> str:
    """Return in how many futures of each set a metric is defined."""
    counts = [(len(result.samples(column)), result.futures) for result in sets]
    return "all" if all(n == of for n, of in counts) else "\n".join(f"{n}/{of}" for n, of in counts)


def _shares(share: Interval) -> tuple[str, str]:
    return share.share.replace(" ", ""), "–" if share.low == share.high else share.range


def _recorded_overlaps(run: Run) -> str:
    """Return the number of overlapping recorded boxes: measurement noise, not collisions."""
    recorded = run.info.get("recorded")
    if recorded is None:
        return "–"
    if recorded["overlaps"]:
        return counted(len(recorded["overlaps"]), "overlap")
    touch = "drac" in run.columns and np.isinf(run.recorded_value("drac") or 0.0)
    return "contact" if touch else "none"


def _number(value: float | None) -> str:
    return "–" if value is None else "∞" if np.isinf(value) else f"{value:.2f}"
