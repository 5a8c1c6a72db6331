"""Card of the vehicles under test: their encounters with the tested models and without."""

from __future__ import annotations

import numpy as np

from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.reports.page.charts import cumulative_plot, line_legend, value_range
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.study import card, plots, table_place
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import Driven, UnderTest

TABLE = "under-test"
_KINDS: dict[Driven, str] = {"under_test": "picked", "baseline": "drawn"}


def under_test_card(run: Run) -> Html:
    """Return the card; empty without vehicles under test or without a baseline."""
    if run.baseline is None or not run.info.get("under_test"):
        return Html()
    tested = run.under_test
    columns = [column for column in critical_columns(tested.columns) if column != COLLISION]
    return card(
        f"Under test, {tested.label}",
        "Only encounters of the vehicles under test count. Without: the same futures and other drivers, with "
        "these vehicles driven as drawn. Curves: share of the futures up to a value, with its 95 % band.",
        table_place(TABLE),
        line_legend([("picked", "with the driver under test"), ("drawn", "without")]),
        plots(*(_chart(tested, column, run.thresholds.get(column)) for column in columns)),
    )


def _chart(tested: UnderTest, column: str, threshold: float | None) -> Html:
    both = {driven: tested.samples(column, driven) for driven in _KINDS}
    curves = [
        (_KINDS[driven], tested.density(column, driven) if np.isfinite(values).any() else None)
        for driven, values in both.items()
    ]
    x = value_range(np.concatenate(list(both.values())), threshold)
    return cumulative_plot(column, curves, x, threshold=threshold)
