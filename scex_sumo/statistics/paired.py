"""Paired tests: values and critical futures of two runs of the same futures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray

ROUNDING: Final = 1e-9  # in the metric's unit


def signs(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return (n,) signs of first - second; 0 for equal infinities and differences by rounding."""
    with np.errstate(invalid="ignore"):
        same = (first == second) | (np.abs(first - second) < ROUNDING)
    return np.where(same, 0.0, np.where(first > second, 1.0, -1.0))


def signed_rank(first: FloatArray, second: FloatArray) -> float:
    """Return the two-sided p of Wilcoxon's signed-rank test, zeros after Pratt; NaN if all pairs are equal.

    Infinite differences are the largest. Normal approximation with the variance of the present ranks. Source:
    Wilcoxon 1945, Pratt 1959.
    """
    from scipy.special import ndtr

    direction = signs(first, second)
    if not direction.any():
        return float("nan")
    finite = np.isfinite(first) & np.isfinite(second)
    size = np.where(finite, np.abs(np.where(finite, first, 0.0) - np.where(finite, second, 0.0)), np.inf)
    size[direction == 0] = 0.0
    ordered = np.sort(size)
    below, not_above = (np.searchsorted(ordered, size, side=end) for end in ("left", "right"))
    rank = (below + not_above + 1) / 2  # equal ones have their mean rank
    total = float((direction * rank).sum())
    return float(2 * ndtr(-abs(total) / np.sqrt(float((rank[direction != 0] ** 2).sum()))))


def mcnemar(first_only: int, second_only: int) -> float:
    """Return the two-sided p of McNemar's exact test (1947); 1 if no future differs.

    Args:
        first_only: futures that are critical in the first run only; ``second_only`` in the second.
    """
    from scipy.special import bdtr

    count = first_only + second_only
    return 1.0 if count == 0 else min(1.0, 2 * float(bdtr(min(first_only, second_only), count, 0.5)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust the p-values of several tests, after Holm 1979; NaN stays."""
    values = np.asarray(p_values, dtype=np.float64)
    known = np.flatnonzero(~np.isnan(values))
    order = known[np.argsort(values[known], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted = values.copy()
    adjusted[order] = np.minimum(np.maximum.accumulate(values[order] * factors), 1.0)
    return [float(value) for value in adjusted]
