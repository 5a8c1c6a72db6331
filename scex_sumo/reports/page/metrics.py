"""Metrics of a report: names, thresholds, drawn ranges, shared values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.page.charts import samples_of_both, ticks, value_range
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import split_atoms

_WORST_SHARE = 0.1
_LEVELS = 9  # shares of critical children at which the effective number of children is known


def metric_words(run: Run, column: str) -> dict[str, Any]:
    """Return name, unit, side, thresholds and drawn range of a metric column.

    ``atoms`` are values that many futures share, of both sets; ``defined`` counts the futures with a value.
    """
    metric = metric_of(column)
    has_recorded = run.recorded is not None and column in run.recorded.column_names
    recorded = run.recorded_value(column) if has_recorded else None
    threshold = run.thresholds.get(column)
    side = metric.side
    samples = np.sort(run.samples(column))
    view = value_range(samples_of_both(run, column), recorded, threshold)
    share = run.p_critical(column) if threshold is not None and samples.size else None
    return {
        "column": column,
        "name": metric.words,
        "unit": metric.column_unit,
        "mean": column.endswith("_mean"),
        "side": side,
        "sign": "≤" if side == "left" else "≥",
        "threshold": threshold,
        "p": None if share is None else {"value": share.value, "low": share.low, "high": share.high},
        "tenth": _worst_tenth(samples, side),
        "recorded": recorded,
        "defined": int(samples.size),
        "atoms": _atoms(run, column),
        "likely_atoms": [] if run.reference is None else _atoms(run.reference, column),
        "view": view,
        "ticks": ticks(*view) if np.isfinite(samples).any() else [],
    }


def _atoms(run: Run, column: str) -> list[float]:
    samples = run.samples(column)
    return [atom.value for atom in split_atoms(samples)[0]] if reflects(run) and samples.size else []


def reflects(run: Run) -> bool:
    """Return whether densities of a run separate shared values and are reflected at 0."""
    return bool(run.info.get("reflect", True))


def _worst_tenth(samples: FloatArray, side: str) -> float | None:
    if not samples.size:
        return None
    level = _WORST_SHARE if side == "left" else 1 - _WORST_SHARE
    return float(np.quantile(samples, level, method="inverted_cdf"))


def effective_numbers(run: Run, sides: Sequence[str]) -> list[list[tuple[float, float]]]:
    """Return for each column pairs of critical share and effective number of children, ascending to 1."""
    hits: list[BoolArray] = []
    shares: list[FloatArray] = []
    levels = np.arange(1, _LEVELS + 1) / (_LEVELS + 1)
    for column, side in zip(run.columns, sides, strict=True):
        values = run.values(column) * (1 if side == "left" else -1)
        defined = values[~np.isnan(values)]
        limits = np.quantile(defined, levels, method="inverted_cdf") if defined.size else np.empty(0)
        with np.errstate(invalid="ignore"):
            hits.append(values[:, None] <= np.unique(limits))
        shares.append(hits[-1].mean(axis=0))
    effective = run.intervals.effective_number(np.concatenate(hits, axis=1).astype(float))
    ends = np.cumsum([share.size for share in shares])[:-1]
    numbers = np.split(np.minimum(effective, 1e9), ends)
    last = [(1.0, float(number[-1:].max(initial=run.children))) for number in numbers]
    return [
        [*zip(share.tolist(), number.tolist(), strict=True), end]
        for share, number, end in zip(shares, numbers, last, strict=True)
    ]
