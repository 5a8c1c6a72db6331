"""Bands around cumulative distributions, and runs that go on until these are as narrow as asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import UsageError
from scex_sumo.statistics.density import CONFIDENCE, dkw_half_width
from scex_sumo.statistics.effects import indicators, pseudo_inverse

FIRST_LOOK: Final = 100
MOST_CHILDREN: Final = 10_000
RARE: Final = 0.2
"""A metric that is defined in a smaller share of the children does not hold up a run."""

_THRESHOLDS = 99
_SPARE_CHILDREN = 30
_CHILDREN_PER_PARAMETER = 2


@dataclass(frozen=True, kw_only=True)
class Look:
    """How surely the metrics are known after some children.

    Attributes:
        children: how many there are.
        width: half-width of the widest band.
        metric: the column that has it.
        left_out: columns that are defined too rarely to count.
    """

    children: int
    width: float
    metric: str
    left_out: tuple[str, ...]


def check_band(band: float) -> None:
    """Raise a `UsageError` for a band that no run can reach."""
    if not 0 < band < 1:
        raise UsageError(f"--until-band: got {band}, needs to be between 0 and 1, e.g. 0.05")


class Bands:
    """Bands around the cumulative distributions of metrics, given who drives whom.

    Independent draws: Dvoretzky-Kiefer-Wolfowitz with the number of children in which the metric is defined;
    it holds for every distribution and number of children, also when a run stops by it, because it does not
    depend on the values.

    Balanced draws: what comes from single vehicles' models and from pairs of them is balanced out as far as
    the design goes, so that little else than the rest makes the distribution vary from run to run. For the
    shares below each of 99 thresholds, least squares on the models of the vehicles, and of their pairs where
    there are twice as many children as that needs, divide the variance into these parts. Each counts as much
    as the design leaves it: by its imbalance, the chi-squared per degree of freedom of how often the models,
    or pairs of them, come (1 on average for independent draws, 0 for perfect balance). The half-width is that
    of independent draws times the largest remaining standard deviation, relative to 1/2. It is an estimate,
    no bound; how often it holds is measured by ``benchmarks/designs.py``. It is never wider than the
    half-width of independent draws.
    """

    def __init__(self, levels: IntArray, *, design: str, confidence: float = CONFIDENCE) -> None:
        """Prepare for children.

        Args:
            levels: (C, V) model of each vehicle in each child.
            design: ``random`` or ``balanced``.
            confidence: of the bands.
        """
        self._confidence = confidence
        self._count = len(levels)
        self._fits: list[tuple[FloatArray, FloatArray, int, float]] = []
        if design == "random":
            return
        parts = [indicators(levels[:, v]) for v in range(levels.shape[1])]
        parts = [p for p in parts if p.shape[1] > 1]
        one = np.concatenate([np.ones((self._count, 1)), *parts], axis=1)
        rank = 1 + sum(p.shape[1] - 1 for p in parts)
        if self._count - rank < _SPARE_CHILDREN:
            return
        self._fit(one, parts)
        rank += sum((p.shape[1] - 1) * (q.shape[1] - 1) for p, q in combinations(parts, 2))
        if len(parts) > 1 and self._count >= _CHILDREN_PER_PARAMETER * rank:
            cells = [(p[:, :, None] * q[:, None, :]).reshape(len(p), -1) for p, q in combinations(parts, 2)]
            self._fit(np.concatenate([one, *cells], axis=1), cells)

    def _fit(self, regressors: FloatArray, balanced: Sequence[FloatArray]) -> None:
        """Prepare least squares that account for what the design balances."""
        inverse, rank = pseudo_inverse(regressors.T @ regressors)
        self._fits.append((regressors, inverse, rank, _imbalance(balanced)))

    def half_width(self, values: FloatArray) -> float:
        """Half-width of the band of a metric, 0 to 1; 1 where it is defined nowhere.

        Args:
            values: (C,) NaN where undefined.
        """
        known = ~np.isnan(values)
        if not known.any():
            return 1.0
        independent = min(dkw_half_width(int(known.sum()), self._confidence), 1.0)
        if not self._fits:
            return independent
        spread = self._deviation(values, known)
        return min(independent, 2 * spread * dkw_half_width(self._count, self._confidence))

    def _deviation(self, values: FloatArray, known: BoolArray) -> float:
        """Largest standard deviation of a share below a threshold that the design leaves.

        Undefined children count as in a ratio of two means: with d = 1 where defined and F the share below
        the threshold among those, the linearised value of a child is d (below - F) / mean d.
        """
        shares = np.arange(1, _THRESHOLDS + 1) / (_THRESHOLDS + 1)
        limits = np.unique(np.quantile(values[known], shares, method="inverted_cdf"))
        below = np.where(known[:, None], values[:, None] <= limits, 0.0)
        linear = np.where(known[:, None], below - below.sum(axis=0) / known.sum(), 0.0) / known.mean()
        variance = (linear**2).mean(axis=0)
        remaining = np.zeros_like(variance)
        for regressors, inverse, rank, imbalance in self._fits:
            residual = linear - regressors @ (inverse @ (regressors.T @ linear))
            left = np.minimum((residual**2).sum(axis=0) / (self._count - rank), variance)
            remaining += min(imbalance, 1.0) * (variance - left)
            variance = left
        return float(np.sqrt((remaining + variance).max()))


def _imbalance(parts: Sequence[FloatArray]) -> float:
    """Mean chi-squared per degree of freedom of how often levels come, against equal counts.

    Levels that are meant to be of different frequency seem imbalanced; that widens the band.
    """
    ratios = []
    for part in parts:
        counts = part.sum(axis=0)
        mean = counts.mean()
        ratios.append(float(((counts - mean) ** 2).sum() / mean / max(len(counts) - 1, 1)))
    return float(np.mean(ratios)) if ratios else 0.0


def look(
    levels: IntArray, values: FloatArray, defined: BoolArray, columns: Sequence[str], *, design: str
) -> Look:
    """How surely the metrics are known.

    Args:
        levels: (C, V) model of each vehicle in each child.
        values: (C, M) of each metric.
        defined: (C, M) False where undefined.
        columns: (M,) names of the metrics.
        design: ``random`` or ``balanced``.
    """
    share = defined.mean(axis=0)
    counted = [m for m in range(len(columns)) if share[m] >= RARE]
    bands = Bands(levels, design=design)
    widths = {columns[m]: bands.half_width(np.where(defined[:, m], values[:, m], np.nan)) for m in counted}
    widest = max(widths, key=lambda name: widths[name], default="")
    return Look(
        children=len(levels),
        width=widths.get(widest, 0.0),
        metric=widest,
        left_out=tuple(columns[m] for m in range(len(columns)) if m not in counted),
    )


def grow(measure: Callable[[int], Look], *, band: float, most: int) -> Look:
    """Run more and more children until the widest band is as narrow as asked for.

    How many are run next depends on what was found only, not on workers, batches or interruptions.

    Args:
        measure: runs the first N children, where they have not run yet, and looks at them.
        band: half-width asked for.
        most: children at which it ends in any case.

    Returns:
        The last look.
    """
    count = min(FIRST_LOOK, most)
    while True:
        found = measure(count)
        if found.width <= band or count >= most:
            return found
        needed = int(np.ceil(1.02 * count * (found.width / band) ** 2))
        count = min(max(count + 20, min(needed, 2 * count)), most)
