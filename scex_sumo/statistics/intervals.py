"""Intervals of means over the futures of a design.

Independent draws have Wilson's interval and the band of Dvoretzky, Kiefer and Wolfowitz. In a balanced design
the variance of the mean is the sum over orders k of s²(k) · b(k): s²(k) is the variance of interactions of k
vehicles, b(k) the mean of the normed kernel of order k over all pairs of rows. s² is estimated from products
of residuals; typical components count like a few futures. p (1 - p) / variance is the number of futures in
Wilson's interval.

Source: Rao 1971 (MINQUE); Wilson 1927. ``benchmarks/intervals.py`` measures the coverage.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import InputError
from scex_sumo.statistics.density import Interval, dkw_half_width, wilson_of

ORDERS: Final = 3
"""Interactions of more vehicles count as noise of single futures."""

MIN_FUTURES: Final = 30
"""With fewer, the interval is that of independent draws."""

_FORMS_FOR: Final = (0.5, 0.2, 0.1, 0.2)  # components by order, then the rest, for which the forms are best
_TYPICAL: Final = (0.6, 0.2, 0.1, 0.1)  # prior components of shares
_PRIOR_FUTURES: Final = 30  # weight of the typical components
_BLOCK_ROWS: Final = 1024
MAX_FUTURES: Final = 4096
"""With more, the interval is that of independent draws: it is narrow, and the matrices need memory."""

_THRESHOLDS: Final = 33
_WIDEST: Final = 0.9  # quantile over thresholds


class DesignIntervals:
    """95 % intervals of shares, and bands of distributions, over the futures of one design.

    Attributes:
        balanced: False for independent draws, which have the ordinary intervals.
        whole: True if all assignments occur once: then nothing is uncertain.
    """

    def __init__(self, levels: IntArray, *, design: str, shares: Sequence[FloatArray]) -> None:
        """Prepare for futures.

        Args:
            levels: (C, V) model of each vehicle in each future, whole numbers from 0.
            design: how the assignments were drawn: ``balanced``, ``all`` of them, or ``random``.
            shares: per vehicle, the intended share of each level.
        """
        self.count = len(levels)
        factors = [(levels[:, vehicle], share) for vehicle, share in enumerate(shares) if len(share) > 1]
        self.whole = design == "all"
        enough = MIN_FUTURES <= self.count <= MAX_FUTURES
        self.balanced = design not in ("random", "all") and bool(factors) and enough
        self._blocks: list[_Block] = []
        self._widths: dict[bytes, FloatArray] = {}
        if self.balanced:
            starts = range(0, self.count, _BLOCK_ROWS)
            parts = [slice(start, start + _BLOCK_ROWS) for start in starts]
            self._blocks = [_Block([(level[p], share) for level, share in factors], p) for p in parts]

    def variance(self, values: FloatArray) -> FloatArray:
        """Return (M,) variances of the means of values (C, M) over the futures under a balanced design."""
        forms = sum(block.forms(values[block.rows]) for block in self._blocks)
        design = sum(block.design for block in self._blocks)
        components = _nonnegative(np.asarray(design), np.asarray(forms))
        return np.asarray(np.maximum(self._weight() @ components, 0.0))

    def _weight(self) -> FloatArray:
        parts = [block.kernel_means * (block.size / self.count) ** 2 for block in self._blocks]
        return np.asarray(np.sum(parts, axis=0))

    def share(self, critical: BoolArray) -> Interval:
        """Return the share of the critical futures (C,) with its interval; NaN without futures."""
        return self.all_shares(np.asarray(critical)[:, None])[0]

    def all_shares(self, critical: BoolArray) -> list[Interval]:
        """Return the shares of many questions at once, (C, M)."""
        hits = np.asarray(critical, dtype=np.float64)
        if len(hits) != self.count:
            raise InputError(f"intervals: {len(hits)} values for the {self.count} futures of the design")
        if self.count == 0:
            return [Interval(value=float("nan"), low=0.0, high=1.0, count=0)] * hits.shape[1]
        share = hits.mean(axis=0)
        effective = self.effective_number(hits)
        bounds = [wilson_of(float(p), float(n)) for p, n in zip(share, effective, strict=True)]
        return [
            Interval(value=float(p), low=low, high=high, count=self.count)
            for p, (low, high) in zip(share, bounds, strict=True)
        ]

    def effective_number(self, critical: FloatArray) -> FloatArray:
        """Return (M,) numbers of independent futures that would be as certain of shares (C, M)."""
        share = critical.mean(axis=0)
        spread = share * (1 - share)
        number = np.full(spread.shape, np.inf if self.whole else float(self.count))
        if not self.balanced:
            return number
        uncertain = np.flatnonzero(spread > 0)
        if not len(uncertain):
            return number
        seen = self.count / (self.count + _PRIOR_FUTURES)
        typical = spread[uncertain] * float(self._weight() @ self._blocks[0].of_orders(_TYPICAL))
        variance = seen * self.variance(critical[:, uncertain]) + (1 - seen) * typical
        # A design of all assignments leaves only rounding.
        known = variance <= 1e-12 * spread[uncertain]
        ratio = spread[uncertain] / np.where(known, 1.0, variance)
        number[uncertain] = np.where(known, np.inf, np.maximum(ratio, self.count))
        return number

    def half_width(self, values: FloatArray) -> float:
        """Return the half-width of the band around the distribution of values (C,), NaN where undefined."""
        return float(self.half_widths(np.asarray(values)[:, None])[0])

    def half_widths(self, values: FloatArray) -> FloatArray:
        """Return (M,) half-widths, 0 to 1, of many metrics at once, (C, M); 1 for a column of NaN."""
        key = values.tobytes()  # the tables and the page ask for the same
        if key not in self._widths:
            self._widths[key] = self._half_widths(values)
        return self._widths[key]

    def _half_widths(self, values: FloatArray) -> FloatArray:
        known = ~np.isnan(values)
        counts = known.sum(axis=0)
        widths = np.array([min(dkw_half_width(n), 1.0) if n else 1.0 for n in counts])
        defined = np.flatnonzero(counts)
        if self.whole:
            widths[defined] = 0.0
        if not self.balanced or defined.size == 0:
            return widths
        linear = [_linearised(values[:, m], known[:, m]) for m in defined]
        spreads = np.sqrt(self.variance(np.concatenate(linear, axis=1)))
        ends = np.cumsum([columns.shape[1] for columns in linear])[:-1]
        for m, spread in zip(defined, np.split(spreads, ends), strict=True):
            # The band of independent draws, in largest standard deviations of a share.
            width = 2 * float(np.quantile(spread, _WIDEST)) * dkw_half_width(1)
            widths[m] = min(widths[m], width)
        return widths


def _linearised(values: FloatArray, known: BoolArray) -> FloatArray:
    levels = np.arange(1, _THRESHOLDS + 1) / (_THRESHOLDS + 1)
    limits = np.unique(np.quantile(values[known], levels, method="inverted_cdf"))
    below = np.where(known[:, None], values[:, None] <= limits, 0.0)
    linear: FloatArray = np.where(known[:, None], below - below.sum(axis=0) / known.sum(), 0.0) / known.mean()
    return linear


class _Block:
    """Rows of a design whose products are looked at together.

    Attributes:
        kernel_means: (K + 1,) mean of the normed kernel of each order over all pairs of rows, and the rest's.
        design: (K + 1, K + 1) the quadratic forms for components of 1.
    """

    def __init__(self, factors: Sequence[tuple[IntArray, FloatArray]], rows: slice) -> None:
        self.rows, self.size = rows, len(factors[0][0])
        every = _kernels(factors)
        kernels = [*every[:ORDERS], np.eye(self.size)]
        means = [float(kernel.mean()) for kernel in every]
        # The rest is mostly of the next order, then of the one after or of random routes.
        after = [*means[ORDERS:], 1 / self.size, 1 / self.size]
        self.kernel_means = np.array([*means[:ORDERS], (2 * after[0] + after[1]) / 3])
        prior = self.of_orders(_FORMS_FOR)
        del every  # the highest orders
        inverse = np.linalg.inv(sum(p * k for p, k in zip(prior, kernels, strict=True)))
        sums = inverse.sum(axis=1)
        # Projects the estimated mean out.
        inverse -= np.outer(sums, sums) / sums.sum()
        parts = [inverse @ kernel for kernel in kernels]
        self.design = np.array([[np.sum(a * b.T) for b in parts] for a in parts])
        self._matrices = [inverse, *kernels[:-1]]

    def of_orders(self, components: Sequence[float]) -> FloatArray:
        """Return (K + 1,) components of the orders that occur, and of the rest."""
        return np.array([*components[: len(self.kernel_means) - 1], components[-1]])

    def forms(self, values: FloatArray) -> FloatArray:
        """Return (K + 1, M) quadratic forms of the residuals of values (R, M)."""
        residuals = self._matrices[0] @ values
        alike = [kernel @ residuals for kernel in self._matrices[1:]]  # the rest has the identity
        return np.stack([(residuals * product).sum(axis=0) for product in (*alike, residuals)])


def _kernels(factors: Sequence[tuple[IntArray, FloatArray]]) -> list[FloatArray]:
    rows, most = len(factors[0][0]), min(ORDERS + 2, len(factors))
    sums = [np.ones((rows, rows)), *(np.zeros((rows, rows)) for _ in range(most))]
    for level, share in factors:
        alike = (level[:, None] == level) * (1 / share)[level]
        alike -= 1
        alike /= len(share) - 1
        for order in range(most, 0, -1):
            sums[order] += sums[order - 1] * alike
    for order in range(1, most + 1):
        sums[order] /= comb(len(factors), order)
    return sums[1:]


def _nonnegative(design: FloatArray, forms: FloatArray) -> FloatArray:
    count = len(design)
    best, solved = np.zeros(forms.shape[1]), np.zeros(forms.shape)
    for size in range(1, count + 1):
        for members in combinations(range(count), size):
            chosen = list(members)
            solution = np.linalg.lstsq(design[np.ix_(chosen, chosen)], forms[chosen], rcond=None)[0]
            cost = -(solution * forms[chosen]).sum(axis=0)
            better = np.all(solution >= 0, axis=0) & (cost < best)
            best = np.where(better, cost, best)
            full = np.zeros(forms.shape)
            full[chosen] = solution
            solved = np.where(better, full, solved)
    return solved
