"""Ranges and round numbers of axes."""

from __future__ import annotations

import math

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH

_ROUND = (1, 2, 5, 10)
_TAIL = 5  # values farther than this from the quartiles, in quartile ranges, are left out
_MIN_SPREAD = 0.25  # least quartile range, in the metric's unit


def ticks(low: float, high: float, most: int = 4) -> list[tuple[float, str]]:
    """Return round numbers in a range, in about ``most`` steps, with their texts."""
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in _ROUND if power * factor >= raw * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(number * step, f"{number * step:.{digits}f}") for number in numbers]


def value_range(
    values: FloatArray, *marks: float | None, limits: tuple[float, float] | None = None
) -> tuple[float, float]:
    """Return the range of an axis: finite values (n,) without a far tail, and near marks; else 0 to 1.

    Limits are the range before marks are added; None takes four bandwidths around the values.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    first, third = np.quantile(finite, [0.25, 0.75])
    tail = _TAIL * max(float(third - first), _MIN_SPREAD)
    margin = 4 * BANDWIDTH
    lowest, highest = limits or (float(finite.min()) - margin, float(finite.max()) + margin)
    floor = 0.0 if finite.min() >= 0 else -math.inf  # no density below 0
    low, high = max(lowest, floor, float(first) - tail), min(highest, float(third) + tail)
    near = 0.5 * (high - low)
    for mark in marks:
        if mark is not None and low - near <= mark <= high + near:
            low, high = min(low, max(mark - BANDWIDTH, floor)), max(high, mark + BANDWIDTH)
    return low, high


def samples_of_both(run: Run, column: str) -> FloatArray:
    """Return the values (n,) of a metric in the stress test and in the human-like futures."""
    both = (run,) if run.reference is None else (run, run.reference)
    return np.concatenate([result.samples(column) for result in both])
