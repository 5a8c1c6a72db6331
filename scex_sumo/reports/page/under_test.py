"""Card of the vehicles under test: their encounters with the tested models and without."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.reports.page.charts import cumulative_plot, line_legend, metric_title, value_range
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.study import Table, card, plots, table, table_place
from scex_sumo.reports.under_test_table import chance_text, differences
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


def under_test_rows(run: Run) -> Table | None:
    """Return the card's table: values and critical shares by metric, with and without."""
    if run.baseline is None or not run.info.get("under_test"):
        return None
    worse = "Futures that are more critical with the driver under test : less critical"
    chance = "How probable so large a difference would be by chance alone (corrected after Holm)"
    heads = [
        ("metric", "text", ""),
        ("median", "real", "Of the futures, with the driver under test"),
        ("without", "real", "Median without"),
        ("worse : better", "text", worse),
        ("by chance", "text", chance),
        ("P(critical)", "percent", "Share of critical futures"),
        ("without", "percent", "Share of critical futures without"),
        ("by chance", "text", chance),
    ]
    rows = [
        [
            metric_title(one.column),
            _real(one.under_test),
            _real(one.baseline),
            f"{one.worse} : {one.better}" if one.children else None,
            chance_text(p_value),
            None if one.p_critical is None else one.p_critical.value,
            None if one.baseline_p_critical is None else one.baseline_p_critical.value,
            chance_text(p_share),
        ]
        for one, p_value, p_share in differences(run.under_test)
    ]
    return table(heads, rows)


def _real(value: float) -> Any:
    return None if math.isnan(value) else value


def _chart(tested: UnderTest, column: str, threshold: float | None) -> Html:
    both = {driven: tested.samples(column, driven) for driven in _KINDS}
    curves = [
        (_KINDS[driven], tested.density(column, driven) if np.isfinite(values).any() else None)
        for driven, values in both.items()
    ]
    x = value_range(np.concatenate(list(both.values())), threshold)
    return cumulative_plot(column, curves, x, threshold=threshold)
