"""Terminal table of vehicles under test, with their models and without."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.metrics.registry import COLLISION, critical_columns, metric_of
from scex_sumo.reports.run_table import counted, print_line, print_table
from scex_sumo.results.under_test import Difference, UnderTest
from scex_sumo.statistics.density import Interval
from scex_sumo.statistics.paired import holm


def print_under_test(tested: UnderTest, console: Console) -> None:
    """Print the comparison, its explanation, and the answer."""
    print_table(under_test_table(tested), console, breaks=(" better",))
    for line in (
        "only pairs that involve a vehicle under test; baseline: the same futures, driven as drawn",
        "worse : better: futures that are more and less critical than in the baseline",
        "p: of no difference; signed-rank test of values, McNemar's of shares, corrected after Holm",
        *([verdict(tested)] if COLLISION in tested.columns else []),
    ):
        print_line(line, console)


def verdict(tested: UnderTest) -> str:
    """Return how often the vehicles under test collide, with their models and without."""
    one, other = tested.p_critical(COLLISION), tested.p_critical(COLLISION, "baseline")
    assert one is not None and other is not None
    shares = f"{one.percent} of futures, in {other.percent} if driven as drawn"
    return f"under test, {tested.label}: collides in {shares}"


def differences(tested: UnderTest) -> list[tuple[Difference, float, float]]:
    """Return by metric the difference, and Holm-corrected p-values of values and critical shares."""
    by_metric = [tested.difference(column) for column in critical_columns(tested.columns)]
    values = holm([one.p_value for one in by_metric])
    shares = holm([one.critical_p_value for one in by_metric])
    return list(zip(by_metric, values, shares, strict=True))


def under_test_table(tested: UnderTest) -> Table:
    """Return medians, critical shares, worse and better futures, and p-values by metric."""
    children = counted(tested.metrics.num_rows, "future")
    table = Table(title=f"under test, {tested.label}: {children}", title_justify="left")
    table.add_column("metric")
    for name in ("median", "baseline", "worse : better", "p", "critical", "baseline", "p"):
        table.add_column(name, justify="right", no_wrap=True)
    for one, p_value, p_share in differences(tested):
        table.add_row(
            Text(metric_of(one.column).titled()),
            *("–" if math.isnan(value) else f"{value:.2f}" for value in (one.under_test, one.baseline)),
            f"{one.worse} : {one.better}" if one.children else "–",
            chance_text(p_value) or "–",
            _share(one.p_critical),
            _share(one.baseline_p_critical),
            chance_text(p_share) or "–",
        )
    return table


def _share(share: Interval | None) -> str:
    return "–" if share is None else f"{share.value:.1%}"


def chance_text(p_value: float) -> str | None:
    """Return a p-value as text; None for NaN."""
    if math.isnan(p_value):
        return None
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"
