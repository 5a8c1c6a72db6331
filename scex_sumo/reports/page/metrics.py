"""Metrics of a report: names, thresholds, drawn ranges, and curves as small integers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.page.charts import ticks, value_range
from scex_sumo.results.densities import DENSITIES, densities_table
from scex_sumo.results.run import Run

Curves: TypeAlias = dict[str, dict[str, FloatArray]]
"""By metric column, arrays of one length: x, pdf, cdf, low, high, atom, as in ``densities.parquet``."""

_CURVES = ("x", "pdf", "cdf", "low", "high", "atom")
_UNITS = (1e-3, 1e-4, 1e-4)  # of x, density and share
_MAX_VALUE = 1e13  # of a curve, so that it fits 64 bits; PTTC reaches 1e11 s
_WORST_SHARE = 0.1
_LEVELS = 9  # shares of critical children at which the effective number of children is known


def metric_words(run: Run, column: str) -> dict[str, Any]:
    """Return name, unit, side, thresholds and drawn range of a metric column.

    ``folded`` tells whether its density is reflected at 0; ``defined`` counts the futures with a value.
    """
    metric, rest = _metric_of_prefix(column.removesuffix("_mean"))
    has_recorded = run.recorded is not None and column in run.recorded.column_names
    recorded = run.recorded_value(column) if has_recorded else None
    threshold = run.thresholds.get(column)
    side = metric.side if metric else "left"
    samples = np.sort(run.samples(column))
    view = value_range(samples, recorded, threshold)
    share = run.p_critical(column) if threshold is not None and samples.size else None
    return {
        "column": column,
        "name": (metric.words if metric else "") + rest.replace("_", " "),
        "unit": metric.column_unit if metric else "",
        "mean": column.endswith("_mean"),
        "side": side,
        "sign": "≤" if side == "left" else "≥",
        "threshold": threshold,
        "p": None if share is None else {"value": share.value, "low": share.low, "high": share.high},
        "tenth": _worst_tenth(samples, side),
        "recorded": recorded,
        "defined": int(samples.size),
        "folded": bool(run.info.get("reflect", True)) and bool(samples.size) and bool(samples[0] >= 0),
        "view": view,
        "ticks": ticks(*view) if np.isfinite(samples).any() else [],
    }


def _metric_of_prefix(base: str) -> tuple[Metric | None, str]:
    """Return the metric that a column begins with, e.g. ``ttc`` of ``ttc_path``, and the rest."""
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
    level = _WORST_SHARE if side == "left" else 1 - _WORST_SHARE
    return float(np.quantile(samples, level, method="inverted_cdf"))


def densities_of(run: Run, columns: Sequence[str]) -> Curves:
    """Return densities by column; computed if the folder has none."""
    if (run.folder / DENSITIES).is_file():
        table = run.table(DENSITIES, columns=("metric", *_CURVES))
    else:
        folded = bool(run.info.get("reflect", True))
        table = densities_table(run.metrics, run.columns, run.intervals, reflect=folded)
    metric = np.asarray(table["metric"])
    arrays = {name: np.asarray(table[name], dtype=np.float64) for name in _CURVES}
    for name, values in arrays.items():
        if not (np.abs(values) < _MAX_VALUE).all():
            raise ResultError(f"{run.folder / DENSITIES}: column {name} has impossible values; run again")
    rows = {column: metric == column for column in columns}
    return {column: {name: values[mine] for name, values in arrays.items()} for column, mine in rows.items()}


def curve_arrays(
    curves: Curves, prefix: str, views: Mapping[str, tuple[float, float]]
) -> dict[str, NDArray[Any]]:
    """Return the curves of metric columns, extended to the ends of their views.

    Returns:
        ``PREFIXn`` (P, 3) of the n-th column with a curve: x, density, share at or below x.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for number, (column, (low, high)) in enumerate(views.items()):
        rows = curves[column]
        x, cdf = rows["x"], rows["cdf"]
        if not x.size:
            continue
        before = [(low, 0.0, 0.0), (float(x[0]), 0.0, 0.0)] if low < x[0] else []
        after = [(float(x[-1]), 0.0, float(cdf[-1])), (high, 0.0, float(cdf[-1]))] if high > x[-1] else []
        whole = np.concatenate(
            [np.reshape(before, (-1, 3)), np.stack([x, rows["pdf"], cdf], axis=1), np.reshape(after, (-1, 3))]
        )
        arrays[f"{prefix}{number}"] = np.rint(whole / _UNITS).astype(np.int64)
    return arrays


def curve_words(curves: Curves, likely: Curves | None, column: str) -> dict[str, Any]:
    """Return atoms and scales of a metric's curves.

    Returns:
        Shares of atoms, half-width ``band``, largest density ``peak``, largest share of an atom ``most``.
    """
    rows = [part[column] for part in (curves, likely) if part is not None]
    atoms = [
        [(x, share) for x, share in zip(part["x"].tolist(), part["atom"].tolist(), strict=True) if share > 0]
        for part in rows
    ]
    ends = np.concatenate([rows[0]["high"] - rows[0]["cdf"], rows[0]["cdf"] - rows[0]["low"]])
    return {
        "atoms": atoms[0],
        "likely_atoms": atoms[-1] if likely is not None else [],
        "band": float(ends.max(initial=0.0)),
        "peak": max(float(part["pdf"].max(initial=1e-9)) for part in rows),
        "most": max(float(part["atom"].max(initial=0.0)) for part in rows),
    }


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
