"""How far the values of one metric are apart in several runs. Axes as in `fingerprint`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.statistics.density import BANDWIDTH, density

Columns: TypeAlias = Sequence[FloatArray]
"""One metric in all runs: R arrays (C,), NaN in the children where it is undefined; inf is a value."""

SPREAD: Final = (0.1, 0.9)  # pooled quantiles between which the middle of all values lies
FENCE: Final = 1.0  # spreads beyond those quantiles at which a value no longer moves a distance


@dataclass(frozen=True, kw_only=True)
class Scale:
    """What one metric's values are measured with, found from the values of all runs together.

    Attributes:
        unit: 1 of distance, in the metric's unit; positive.
        middle: pooled median; stands in for children in which the metric is undefined.
        low: values below count as this one.
        high: values above count as this one, infinite ones too.
    """

    unit: float
    middle: float
    low: float
    high: float

    def place(self, column: FloatArray) -> FloatArray:
        """(C,) values within the fences in units of the scale; undefined ones lie at the middle."""
        known = np.where(np.isnan(column), self.middle, column)
        return np.clip((known - self.middle) / self.unit, *self.fences)

    @property
    def fences(self) -> tuple[float, float]:
        """``low`` and ``high`` in units of the scale, from the middle."""
        return (self.low - self.middle) / self.unit, (self.high - self.middle) / self.unit


def pooled_scale(columns: Columns) -> Scale:
    """Scale of a metric from the finite values of all runs, every run weighing the same.

    The unit is the width of the middle 80 % of the values; where more than 80 % agree, that of all values;
    where all agree, 1. The fences lie one unit beyond the middle 80 %.

    Args:
        columns: one metric in all runs.
    """
    finite = [column[np.isfinite(column)] for column in columns]
    pool = np.concatenate(finite)
    if pool.size == 0:
        return Scale(unit=1.0, middle=0.0, low=-1.0, high=1.0)
    weight = np.concatenate([np.full(v.size, 1 / v.size) for v in finite if v.size])
    low, middle, high = _quantiles(pool, weight, (SPREAD[0], 0.5, SPREAD[1]))
    if low == high:
        low, high = float(pool.min()), float(pool.max())
    unit = high - low if high > low else 1.0
    return Scale(unit=unit, middle=middle, low=low - FENCE * unit, high=high + FENCE * unit)


def wasserstein_distances(columns: Columns, scale: Scale) -> FloatArray:
    """(R, R) Wasserstein-1 of one metric in units of its scale: the area between the distributions.

    Every child counts, at the place that the scale gives it, so the triangle inequality holds.
    """
    placed = [np.sort(scale.place(column)) for column in columns]
    at = np.unique(np.concatenate(placed))
    shares = np.stack([np.searchsorted(p, at, side="right") / p.size for p in placed])
    width = np.diff(at)
    areas = np.zeros((len(placed), len(placed)))
    for r in range(len(placed) - 1):
        areas[r, r + 1 :] = np.abs(shares[r + 1 :, :-1] - shares[r, :-1]) @ width
    return areas + areas.T


def jensen_shannon_distances(columns: Columns, bandwidth: float = BANDWIDTH) -> FloatArray:
    """(R, R) square root of the Jensen-Shannon divergence (base 2) of one metric; 0 equal, 1 disjoint.

    Densities with the absolute bandwidth on a common grid; undefined and infinite values are two more
    classes. The square root is a metric (Endres and Schindelin 2003).
    """
    finite = [column[np.isfinite(column)] for column in columns]
    pool = np.concatenate(finite)
    grid = density(pool, bandwidth).x if pool.size else np.empty(0)
    masses = np.zeros((len(columns), grid.size + 3))
    for row, column, values in zip(masses, columns, finite, strict=True):
        if values.size:
            heights = density(values, bandwidth, x=grid).pdf
            row[: grid.size] = heights / heights.sum() * (values.size / column.size)
        classes = (np.isnan(column), column == np.inf, column == -np.inf)
        row[grid.size :] = [np.count_nonzero(which) / column.size for which in classes]
    entropy = _entropy(masses)
    divergence = np.zeros((len(columns), len(columns)))
    for r in range(len(columns) - 1):
        others = masses[r + 1 :]
        divergence[r, r + 1 :] = _entropy((others + masses[r]) / 2) - (entropy[r + 1 :] + entropy[r]) / 2
    # Differences of entropies leave 1e-16 where nothing differs, and its root would be 1e-8.
    divergence = np.where(divergence < 1e-14, 0.0, np.minimum(divergence, 1.0))
    return np.asarray(np.sqrt(divergence + divergence.T))


def _quantiles(values: FloatArray, weight: FloatArray, levels: Sequence[float]) -> list[float]:
    """Quantiles of weighted values: the smallest value with at least this share of the weight up to it."""
    # Runs given in another order must find the same value, and sums in another order round differently.
    at, group = np.unique(values, return_inverse=True)
    share = np.cumsum(np.bincount(group, weight)) / weight.sum()
    return [float(at[min(int(np.searchsorted(share, q - 1e-9)), at.size - 1)]) for q in levels]


def _entropy(masses: FloatArray) -> FloatArray:
    """(R,) entropy in bits of the rows."""
    logarithm = np.log2(masses, where=masses > 0, out=np.zeros_like(masses))
    return np.asarray(-np.sum(masses * logarithm, axis=1))
