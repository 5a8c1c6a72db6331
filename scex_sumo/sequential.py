"""Runs that go on until the distributions are known as surely as asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.density import CONFIDENCE, dkw_half_width
from scex_sumo.errors import UsageError
from scex_sumo.scene import BoolArray, FloatArray, IntArray

FIRST_LOOK: Final = 100
MOST_CHILDREN: Final = 10_000
RARE: Final = 0.05
"""A metric that is defined in a smaller share of the children does not hold up a run."""

DESIGNS_THAT_GROW: Final = ("random", "balanced")
_THRESHOLDS = 99
_SPARE_CHILDREN = 30


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


def check_band(band: float, design: str) -> None:
    """Raise a `UsageError` for a band that no run can reach, or a design that cannot grow."""
    if not 0 < band < 1:
        raise UsageError(f"--until-band: got {band}, needs to be between 0 and 1, e.g. 0.05")
    if design not in DESIGNS_THAT_GROW:
        raise UsageError(
            f"--until-band: a design of {design} cannot grow; use --design {' or '.join(DESIGNS_THAT_GROW)}"
        )


def band_half_width(
    levels: IntArray, values: FloatArray, *, design: str, confidence: float = CONFIDENCE
) -> float:
    """Half-width of the band around the cumulative distribution of a metric.

    Independent draws: Dvoretzky-Kiefer-Wolfowitz with the number of children in which the metric is defined;
    it holds for every distribution and number of children, also when a run stops by it, because it does not
    depend on the values.

    Balanced draws: the part of the variance that comes from single vehicles' models is balanced out, so that
    only the rest makes the distribution vary from run to run. The half-width is that of independent draws
    times the largest residual standard deviation, over 99 thresholds, of the shares below a threshold, fitted
    by the vehicles' models, relative to 1/2. It is an estimate: no bound, and it counts nothing of what
    balanced pairs gain further. How often it holds is measured by ``benchmarks/designs.py``. It is never
    wider than the half-width of independent draws.

    Args:
        levels: (C, V) model of each vehicle in each child.
        values: (C,) NaN where undefined.
        design: ``random`` or ``balanced``.
        confidence: of the band.

    Returns:
        Half-width, 0 to 1; 1 where the metric is defined nowhere.
    """
    known = ~np.isnan(values)
    count = int(known.sum())
    if count == 0:
        return 1.0
    independent = dkw_half_width(count, confidence)
    spread = _residual_deviation(levels, values, known) if design == "balanced" else None
    if spread is None:
        return min(independent, 1.0)
    return min(independent, 2 * spread * dkw_half_width(len(values), confidence), 1.0)


def _residual_deviation(levels: IntArray, values: FloatArray, known: BoolArray) -> float | None:
    """Largest standard deviation that the vehicles' models leave of a share below a threshold.

    Undefined children count as in a ratio of two means: with d = 1 where defined and F the share below the
    threshold among those, the linearised value of a child is d (below - F) / mean d.
    """
    columns = [levels[:, v] for v in range(levels.shape[1]) if len(np.unique(levels[:, v])) > 1]
    indicators = [c[:, None] == np.unique(c)[None] for c in columns]
    regressors = np.concatenate([np.ones((len(levels), 1)), *indicators], axis=1)
    size, vectors = np.linalg.eigh(regressors.T @ regressors)
    some = size > 1e-10 * size[-1]
    spare = len(levels) - int(some.sum())
    if spare < _SPARE_CHILDREN:
        return None
    inverse = (vectors[:, some] / size[some]) @ vectors[:, some].T
    shares = np.arange(1, _THRESHOLDS + 1) / (_THRESHOLDS + 1)
    limits = np.unique(np.quantile(values[known], shares, method="inverted_cdf"))
    below = np.where(known[:, None], values[:, None] <= limits, 0.0)
    linear = np.where(known[:, None], below - below.sum(axis=0) / known.sum(), 0.0) / known.mean()
    residual = linear - regressors @ (inverse @ (regressors.T @ linear))
    return float(np.sqrt((residual**2).sum(axis=0).max() / spare))


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
    widths = {
        columns[m]: band_half_width(levels, np.where(defined[:, m], values[:, m], np.nan), design=design)
        for m in counted
    }
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
