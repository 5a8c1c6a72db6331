"""Card of the driver under test on a run's page."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.page.document import Document, card, table
from scex_sumo.page.figures.axes import ticks, value_range
from scex_sumo.page.figures.charts import line_legend, metric_title
from scex_sumo.page.html import Html, element
from scex_sumo.reports.under_test import HEADS, under_test_rows, verdict
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import Driven, UnderTest

TABLE: Final = "under-test"
_KINDS: dict[Driven, str] = {"under_test": "picked", "baseline": "drawn"}


def under_test_part(page: Document, run: Run) -> tuple[str, Html]:
    """Add curves and table of a run with a baseline to its page; return the verdict and their card."""
    tested = UnderTest.of(run)
    page.info["tested_curves"] = under_test_curves(run, tested)
    return verdict(tested), card(
        f"Under test, {tested.label}",
        "Only encounters of the vehicles under test count. Without: the same futures and other drivers, with "
        "these vehicles driven as drawn. Curves: share of the futures up to a value, with its 95 % band.",
        page.table(TABLE, table(HEADS, under_test_rows(tested))),
        line_legend([("picked", "with the driver under test"), ("drawn", "without")]),
        element("div.charts", id="tested-curves"),
    )


def under_test_curves(run: Run, tested: UnderTest) -> list[dict[str, Any]]:
    """Return by metric the values with the driver under test and without, and half-widths of their bands."""
    curves: list[dict[str, Any]] = []
    for column in critical_columns(tested.columns):
        if column == COLLISION:
            continue
        limit, sets, values = run.thresholds.get(column), [], []
        for driven, kind in _KINDS.items():
            values.append(tested.samples(column, driven))
            if np.isfinite(values[-1]).any():
                curve = tested.density(column, driven)
                band = float((curve.band[1] - curve.cdf).max())
                sets.append({"kind": kind, "values": values[-1].tolist(), "band": band})
        view, metric = value_range(np.concatenate(values), limit), run.metric(column)
        about = {"title": metric_title(column, metric), "side": metric.side, "threshold": limit}
        curves.append(about | {"view": view, "ticks": ticks(*view), "sets": sets})
    return curves
