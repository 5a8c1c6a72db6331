"""Distances between distributions of one metric. Axes are R (run), C (child), D (draw)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.statistics.density import BANDWIDTH, density

Columns: TypeAlias = Sequence[FloatArray]
"""One metric in all runs: R arrays (C,), NaN in the children where it is undefined; inf is a value."""

SPREAD: Final = (0.1, 0.9)  # pooled quantiles between which the middle of all values lies
FENCE: Final = 1.0  # spreads beyond those quantiles at which a value no longer moves a distance

_DRAWS_AT_ONCE = 20
_LARGEST = 1e300  # larger values count as this one: differences stay finite
_KERNEL_REACH = 8  # bandwidths; beyond, the kernel is below 1e-14 of its height


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Unit of one metric, from the values of all runs together.

    Attributes:
        unit: 1 of distance, in the metric's unit; positive.
        middle: pooled median; stands for undefined values.
        low: lower values count as this one.
        high: higher values, also inf, count as this one.
    """

    unit: float
    middle: float
    low: float
    high: float

    def place(self, column: FloatArray) -> FloatArray:
        """Return values (C,) within the fences in units of the scale; undefined ones lie at the middle."""
        known = np.where(np.isnan(column), self.middle, column)
        return (np.clip(known, self.low, self.high) - self.middle) / self.unit


def pooled_scale(columns: Columns) -> Scale:
    """Return the scale of a metric from the finite values of all runs, each run with the same weight.

    The unit is the width of the middle 80 % of the values. The fences lie one unit beyond it.
    """
    finite = [np.clip(column[np.isfinite(column)], -_LARGEST, _LARGEST) for column in columns]
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
    """Return the Wasserstein-1 distances (R, R) of one metric in units of its scale.

    Every child counts, so the triangle inequality holds.
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
    """Return the square roots (R, R) of the Jensen-Shannon divergences (base 2) of one metric.

    0 for equal, 1 for disjoint densities. Undefined and infinite values are classes of their own.

    Source: Endres and Schindelin 2003.
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
    # Runs given in another order must find the same value, and sums in another order round differently.
    at, group = np.unique(values, return_inverse=True)
    share = np.cumsum(np.bincount(group, weight)) / weight.sum()
    return [float(at[min(int(np.searchsorted(share, q - 1e-9)), at.size - 1)]) for q in levels]


def _entropy(masses: FloatArray) -> FloatArray:
    logarithm = np.log2(masses, where=masses > 0, out=np.zeros_like(masses))
    return np.asarray(-np.sum(masses * logarithm, axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Distances of draws from the truth, in one metric.

    Attributes:
        ks: (D,) Kolmogorov-Smirnov; NaN if the metric is defined in no child of a draw.
        w1: (D,) Wasserstein-1, in the metric's unit.
        jsd: (D,) Jensen-Shannon divergence, base 2, of the kernel densities.
    """

    ks: FloatArray
    w1: FloatArray
    jsd: FloatArray


def errors(values: FloatArray, draws: Sequence[IntArray] | IntArray) -> Errors:
    """Compute distances between the distribution of a metric over some children and over all.

    Args:
        values: (N,) of all children; only finite ones count.
        draws: D arrays of children.
    """
    defined = np.flatnonzero(np.isfinite(values))
    nothing = np.full(len(draws), np.nan)
    if len(defined) == 0:
        return Errors(ks=nothing, w1=nothing, jsd=nothing)
    at, place = np.unique(values[defined], return_inverse=True)
    rank = np.full(len(values), len(at), dtype=np.int64)  # undefined ones are counted behind the last
    rank[defined] = place
    counts = np.stack([np.bincount(rank[d], minlength=len(at) + 1)[: len(at)] for d in draws])
    number = counts.sum(axis=1)
    some = number > 0
    share = counts[some] / number[some, None]
    whole = np.bincount(place, minlength=len(at)) / len(defined)
    apart = np.abs(np.cumsum(share, axis=1) - np.cumsum(whole))
    ks, w1, jsd = nothing, nothing.copy(), nothing.copy()
    ks[some] = apart.max(axis=1)
    w1[some] = apart[:, :-1] @ np.diff(at)
    jsd[some] = _divergence(at, share, whole)
    return Errors(ks=ks, w1=w1, jsd=jsd)


def _divergence(at: FloatArray, share: FloatArray, whole: FloatArray) -> FloatArray:
    """Return divergences (D,) of weighted samples from the truth."""
    from scipy.sparse import csr_matrix

    grid = density(at).x
    reach = _KERNEL_REACH * BANDWIDTH
    start, stop = np.searchsorted(grid, at - reach), np.searchsorted(grid, at + reach)
    ends = np.concatenate([[0], np.cumsum(stop - start)])
    column = np.arange(ends[-1]) - np.repeat(ends[:-1] - start, stop - start)
    z = (grid[column] - np.repeat(at, stop - start)) / BANDWIDTH
    kernel = csr_matrix((np.exp(-0.5 * z * z), column, ends), shape=(len(at), len(grid)))
    truth_mass = np.asarray(kernel.T @ whole)
    truth_mass /= truth_mass.sum()
    result = np.empty(len(share))
    for first in range(0, len(share), _DRAWS_AT_ONCE):
        part = slice(first, first + _DRAWS_AT_ONCE)
        for draw, mass in enumerate((csr_matrix(share[part]) @ kernel).toarray(), first):
            mass /= mass.sum()
            middle = (mass + truth_mass) / 2
            result[draw] = (_entropy_part(mass, middle) + _entropy_part(truth_mass, middle)) / 2
    return np.clip(result, 0.0, 1.0)


def _entropy_part(mass: FloatArray, middle: FloatArray) -> float:
    some = mass > 0
    return float(np.sum(mass[some] * np.log2(mass[some] / middle[some])))
