"""Normal distribution and its quantiles, without all that `scipy.special` loads beside them."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from scex_sumo.arrays import FloatArray

_HALF_SQRT = np.sqrt(0.5)
_QUANTILES = {0.975: 1.959963984540054}  # what 95 % confidence asks for


def normal_cdf(z: FloatArray) -> FloatArray:
    """Phi(z), to the bit what `scipy.special.ndtr` gives.

    Importing `scipy.special` takes as long as a hundred children; the error functions are all that is needed.
    """
    error = _error_functions()
    x = z * _HALF_SQRT
    tail = 0.5 * error.erfc(np.abs(x))
    outside: FloatArray = np.where(x > 0, 1.0 - tail, tail)
    return np.where(np.abs(x) < _HALF_SQRT, 0.5 + 0.5 * error.erf(x), outside)


def normal_quantile(share: float) -> float:
    """z with Phi(z) = ``share``, as `scipy.special.ndtri`."""
    if share in _QUANTILES:
        return _QUANTILES[share]
    from scipy.special import ndtri

    return float(ndtri(share))


@cache
def _error_functions() -> ModuleType:
    """A module with ``erf`` and ``erfc``: scipy's compiled one alone, or `scipy.special`."""
    package = importlib.util.find_spec("scipy")
    for folder in (package.submodule_search_locations or ()) if package else ():
        for file in Path(folder, "special").glob("_special_ufuncs.*"):
            spec = importlib.util.spec_from_file_location("_special_ufuncs", file)
            if spec is None or spec.loader is None:
                continue
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            if hasattr(module, "erf") and hasattr(module, "erfc"):
                return module
    import scipy.special

    whole: ModuleType = scipy.special
    return whole
