"""Runs that go on until the bands around all cumulative distributions are narrow enough."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.statistics.intervals import DesignIntervals

FIRST_LOOK: Final = 100
RARE: Final = 0.2
"""Metrics that are defined in a smaller share of the futures do not count."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """Certainty of the metrics after some futures.

    Attributes:
        width: half-width of the widest band, that of ``metric``.
        left_out: columns that are defined too rarely to count.
    """

    futures: int
    width: float
    metric: str
    left_out: tuple[str, ...]


def look(intervals: DesignIntervals, values: FloatArray, defined: BoolArray, columns: Sequence[str]) -> Look:
    """Find the widest band of all metrics.

    Args:
        values: (C, M) of each metric.
        defined: (C, M).
        columns: (M,) names of the metrics.
    """
    share = defined.mean(axis=0)
    counted = [m for m in range(len(columns)) if share[m] >= RARE]
    widths = {
        columns[m]: intervals.half_width(np.where(defined[:, m], values[:, m], np.nan)) for m in counted
    }
    widest = max(widths, key=lambda name: widths[name], default="")
    return Look(
        futures=intervals.count,
        width=widths.get(widest, 0.0),
        metric=widest,
        left_out=tuple(columns[m] for m in range(len(columns)) if m not in counted),
    )


def grow(measure: Callable[[int], Look], *, band: float, most: int) -> Look:
    """Run more and more futures until the widest band is narrow; return the last look.

    The next number depends on the values only, not on workers, batches or interruptions.

    Args:
        measure: runs the first N futures if they have not run yet, and looks at all.
        most: futures at which it ends in any case.
    """
    count = min(FIRST_LOOK, most)
    while True:
        latest = measure(count)
        if latest.width <= band or count >= most:
            return latest
        needed = int(np.ceil(1.02 * count * (latest.width / band) ** 2))
        count = min(max(count + 20, min(needed, 2 * count)), most)
