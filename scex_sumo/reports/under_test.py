"""Terminal table of vehicles under test, with their models and without."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.reports.console_table import console_table, print_line, print_table
from scex_sumo.reports.run_table import SEVERITY, shown_columns
from scex_sumo.reports.words import MAIN, Head, counted
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import criticality, event_of, share_of
from scex_sumo.results.under_test import Difference, UnderTest
from scex_sumo.statistics.paired import holm, signed_rank

_BY_CHANCE = "Chance of so large a difference without an effect (corrected after Holm)"
HEADS: Final[tuple[Head, ...]] = (
    ("metric", "names", ""),
    ("before", "real", "Median of the futures, as drawn"),
    ("after", "real", "Median with the driver under test"),
    ("worse : better", "text", "Futures that are more critical with the driver under test : less critical"),
    ("p", "text", _BY_CHANCE),
    ("P before", "percent", "Share of critical futures, as drawn"),
    ("P after", "percent", "Share of critical futures with the driver under test"),
    ("p", "text", _BY_CHANCE),
)
_CHANCE = 0.05  # p-value from which on a difference may be chance
_MOST = 3  # encounters in words


def print_under_test(run: Run, console: Console, *, every: bool = False) -> None:
    """Print the verdict, the vehicle's own encounters, and its comparison with the baseline."""
    tested = UnderTest.of(run)
    print_line(verdict(tested), console)
    if own := own_encounters(run):
        print_line("its encounters, as drawn → under test:", console)
    for line in own:
        print_line(f"  {line}", console)
    main, folded = shown_columns(run, every=every)
    print_table(under_test_table(tested, [*main, *folded]), console, breaks=(" better",))
    for line in (
        "only pairs that involve a vehicle under test; before: the same futures, as drawn; P: critical",
        "worse : better: futures that are more and less critical than before",
        "p: chance of such a difference without an effect (signed-rank test; shares: McNemar; Holm)",
        "",
    ):
        print_line(line, console)


def verdict(tested: UnderTest) -> str:
    """Return collisions and severe injuries before and after, and whether the driver is better, in words."""
    changes = differences(tested)
    hits = next(((change, p) for change, _, p in changes if change.column == COLLISION), None)
    others = [(change, p) for change, p, _ in changes if change.column != COLLISION]
    main = [(change, p) for change, p in others if change.column in MAIN]
    sure = [(tested.metric(change.column).words, change) for change, p in main or others if p < _CHANCE]
    better = [words for words, change in sure if change.better > change.worse]
    worse = [words for words, change in sure if change.worse > change.better]
    parts = [f"{word} in {', '.join(n)}" for word, n in (("better", better), ("worse", worse)) if n]
    found_words = {(True, True): "mixed", (True, False): "better", (False, True): "worse"}
    word = found_words.get((bool(better), bool(worse)), "no difference shown")
    text = f"under test, {tested.label}, as drawn → under test: "
    if hits is not None:
        hit, p_value = hits
        assert hit.p_critical is not None and hit.baseline_p_critical is not None
        text += f"collides in {hit.baseline_p_critical.percent} → {hit.p_critical.percent} of futures"
        text += f" (p {chance_text(p_value)})" if chance_text(p_value) else ""
        if p_value < _CHANCE:
            word = "worse" if hit.newly_critical > hit.no_longer_critical else "better"
            parts = [f"collides {'more' if word == 'worse' else 'less'} often", *parts]
    before, after = (1000 * tested.injuries[k].mean() for k in ("baseline", "under_test"))
    text += f", severe injuries per 1000 {before:.2f} → {after:.2f}"
    return f"{text}; verdict: {word}" + (f" ({'; '.join(parts)}; p < {_CHANCE:g})" if parts else "")


def own_encounters(run: Run) -> list[str]:
    """Return the most critical encounters of the vehicles under test, with their shares before and after."""
    assert run.baseline is not None
    ids = {int(track) for track in run.info["under_test"]}
    sides: list[dict[frozenset[int], Mapping[str, Any]]] = []
    for result in (run.baseline, run):
        by_pair = {frozenset(_track_ids(row)): row for row in result.encounters.to_pylist()}
        sides.append({pair: row for pair, row in by_pair.items() if pair & ids})
    worst = [min((side[p] for side in sides if p in side), key=criticality) for p in sides[0] | sides[1]]
    lines = []
    for encounter in sorted(worst, key=criticality)[:_MOST]:
        event, words = event_of(encounter)
        if event:
            pair = frozenset(_track_ids(encounter))
            shares = [share_of(side[pair], event).percent if pair in side else "0 %" for side in sides]
            about = (encounter["kind"], encounter["place"], f"{encounter['time_s']:.1f} s")
            names = " → ".join(str(run.name_of(track)) for track in _track_ids(encounter))
            lines.append(f"{names} ({', '.join(filter(None, about))}): {words} in {' → '.join(shares)}")
    return lines


def _track_ids(row: Mapping[str, Any]) -> tuple[int, int]:
    return row["track_id"], row["other_id"]


def differences(tested: UnderTest) -> list[tuple[Difference, float, float]]:
    """Return by metric the difference, and Holm-corrected p-values of values and critical shares."""
    by_metric = [tested.difference(column) for column in critical_columns(tested.columns)]
    values = holm([difference.p_value for difference in by_metric])
    shares = holm([difference.critical_p_value for difference in by_metric])
    return list(zip(by_metric, values, shares, strict=True))


def under_test_table(tested: UnderTest, columns: Sequence[str] | None = None) -> Table:
    """Return medians, worse and better futures, critical shares and p-values by metric."""
    futures = counted(tested.metrics.num_rows, "future")
    return console_table(f"under test, {tested.label}: {futures}", HEADS, under_test_rows(tested, columns))


def under_test_rows(tested: UnderTest, columns: Sequence[str] | None = None) -> list[list[Any]]:
    """Return the rows of the table of `HEADS`; ``columns`` are those of the metrics shown, None: all."""
    rows: list[list[Any]] = []
    for change, p_value, p_share in differences(tested):
        if columns is not None and change.column not in (COLLISION, *columns):
            continue
        is_share = change.column == COLLISION
        rows.append(
            [
                tested.metric(change.column).titled(),
                *(None if is_share or math.isnan(v) else v for v in (change.baseline, change.under_test)),
                f"{change.worse} : {change.better}" if change.futures else None,
                chance_text(p_value),
                *(None if p is None else p.value for p in (change.baseline_p_critical, change.p_critical)),
                chance_text(p_share),
            ]
        )
        if is_share:
            before, after = tested.injuries["baseline"], tested.injuries["under_test"]
            counts = f"{int((after > before).sum())} : {int((after < before).sum())}"
            means = [1000 * float(side.mean()) for side in (before, after)]
            rows.append([SEVERITY, *means, counts, chance_text(signed_rank(after, before)), *(None,) * 3])
    return rows


def chance_text(p_value: float) -> str | None:
    """Return a p-value as text; None for NaN."""
    if math.isnan(p_value):
        return None
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"
