"""Pseudo-random numbers that follow from the one draw that a vehicle has in a future."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from scex_sumo.base.arrays import FloatArray

_WEYL = np.uint64(0x9E3779B97F4A7C15)


def uniforms(draw: FloatArray, count: int, salt: int = 0) -> FloatArray:
    """Return (n, count) pseudo-random numbers in (0, 1) that follow from one number each.

    Args:
        draw: (n,) in [0, 1), one per vehicle of a future.

    Source: the mixing function of SplitMix64, Steele, Lea, Flood 2014.
    """
    with np.errstate(over="ignore"):
        step = np.arange(1, count + 1, dtype=np.uint64) + np.uint64(64 * (salt + 1))
        z = np.ascontiguousarray(draw, dtype=np.float64).view(np.uint64)[:, None] + step * _WEYL
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    result: FloatArray = ((z >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53
    return result


def normal_quantiles(uniform: FloatArray) -> FloatArray:
    """Return the standard normal quantiles of numbers in (0, 1), any shape.

    The import of ``scipy.special`` would take longer than these values.
    """
    return np.asarray(np.frompyfunc(NormalDist().inv_cdf, 1, 1)(uniform), dtype=np.float64)
