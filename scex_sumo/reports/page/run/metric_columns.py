"""Metric columns of a page: what each is called, where it is critical, what part of it is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.errors import UsageError
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.page.svg import ticks
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH

_WORST = 0.1
_SPREAD = 0.25
"""Least range between the quartiles that is looked at, in the metric's unit."""


def metric_words(run: Run, column: str) -> dict[str, Any]:
    """One metric column: its name, unit and side, limits, and the range of values that is drawn.

    ``folded`` says whether its density has been folded back at 0, ``defined`` in how many children it is.
    """
    found, rest = _known_metric(column.removesuffix("_mean"))
    is_known = run.recorded is not None and column in run.recorded.column_names
    recorded = run.recorded_value(column) if is_known else None
    threshold = run.thresholds.get(column)
    side = found.side if found else "left"
    samples = np.sort(run.samples(column))
    view = _view(samples, [recorded, threshold])
    share = run.p_critical(column) if threshold is not None and samples.size else None
    return {
        "column": column,
        "name": (found.words if found else "") + rest.replace("_", " "),
        "unit": found.column_unit if found else "",
        "mean": column.endswith("_mean"),
        "side": side,
        "sign": "≤" if side == "left" else "≥",
        "threshold": threshold,
        "p": None if share is None else {"value": share.value, "low": share.low, "high": share.high},
        "tenth": _worst_tenth(samples, side),
        "recorded": recorded,
        "defined": int(samples.size),
        "folded": bool(run.info.get("reflect", True)) and bool(samples.size) and bool(samples[0] >= 0),
        "view": view or (0.0, 1.0),
        "ticks": ticks(*view) if view else [],
    }


def _known_metric(base: str) -> tuple[Metric | None, str]:
    """The metric that a column begins with, e.g. that of ``ttc_path``, and how the column goes on."""
    words = base.split("_")
    for count in range(len(words), 0, -1):
        name = "_".join(words[:count])
        try:
            return metric_of(name), base[len(name) :]
        except UsageError:
            continue
    return None, base


def _worst_tenth(samples: FloatArray, side: str) -> float | None:
    if not samples.size:
        return None
    level = _WORST if side == "left" else 1 - _WORST
    return float(np.quantile(samples, level, method="inverted_cdf"))


def _view(values: FloatArray, marks: list[float | None]) -> tuple[float, float] | None:
    """Where most of the finite values are, with recorded value and threshold if near; None without any.

    Args:
        values: (n,) ascending.
        marks: that should be seen.
    """
    samples = values[np.isfinite(values)]
    if not samples.size:
        return None
    first, third = np.quantile(samples, (0.25, 0.75))
    reach = 5 * max(third - first, _SPREAD)
    low = max(samples[0] - 4 * BANDWIDTH, first - reach)
    high = min(samples[-1] + 4 * BANDWIDTH, third + reach)
    near = (high - low) / 2
    for mark in marks:
        if mark is not None and low - near < mark < high + near:
            low, high = min(low, mark - BANDWIDTH), max(high, mark + BANDWIDTH)
    return float(low), float(high)
