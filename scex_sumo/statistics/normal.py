"""Normal distribution and its quantiles, without all that `scipy.special` loads beside them."""

from __future__ import annotations

import importlib

from scex_sumo.arrays import FloatArray
from scex_sumo.compiled import compiled


def normal_cdf(z: FloatArray) -> FloatArray:
    """Phi(z), as `scipy.special.ndtr`."""
    result: FloatArray = _functions.ndtr(z)
    return result


def normal_quantiles(share: FloatArray) -> FloatArray:
    """The z with Phi(z) = ``share``, as `scipy.special.ndtri`."""
    result: FloatArray = _functions.ndtri(share)
    return result


def normal_quantile(share: float) -> float:
    """One z with Phi(z) = ``share``."""
    return float(_functions.ndtri(share))


_functions = compiled("scipy.special", "_ufuncs", "ndtr", "ndtri") or importlib.import_module("scipy.special")
