"""Wilson's interval of a share of whole trials; intervals of designs with equal shares."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.statistics.density import Interval, wilson_of
from scex_sumo.statistics.intervals import DesignIntervals


def wilson(successes: int, count: int) -> Interval:
    """The share of successes with its score interval (Wilson 1927)."""
    low, high = wilson_of(successes / count, count)
    return Interval(value=successes / count, low=low, high=high, count=count)


def equal_shares(levels: IntArray, design: str) -> DesignIntervals:
    """Intervals of a design (C, V) in which all levels from 0 on have the same share."""
    counts = levels.max(axis=0, initial=0) + 1
    return DesignIntervals(levels, design=design, shares=[np.full(count, 1 / count) for count in counts])
