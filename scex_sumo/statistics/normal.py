"""Normal distribution and its quantiles."""

from __future__ import annotations

from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import FloatArray


def normal_cdf(z: FloatArray) -> FloatArray:
    """Return Phi(z)."""
    result: FloatArray = ndtr(z)
    return result


def normal_quantiles(share: FloatArray) -> FloatArray:
    """Return the z with Phi(z) = ``share``."""
    result: FloatArray = ndtri(share)
    return result


def normal_quantile(share: float) -> float:
    """Return one z with Phi(z) = ``share``."""
    return float(ndtri(share))
