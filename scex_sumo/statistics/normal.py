"""Normal distribution and its quantiles, without all that `scipy.special` loads beside them."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from scex_sumo.arrays import FloatArray


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


def _compiled() -> ModuleType:
    """Scipy's compiled functions: by themselves, or `scipy.special` where they are not to be had so.

    What that package has in Python takes as long to import as a hundred children to run. An empty one stands
    in its place while the compiled functions are imported: when this module is, before threads import too.
    """
    whole = "scipy.special"
    if whole not in sys.modules and (scipy := importlib.util.find_spec("scipy")) is not None:
        empty = ModuleType(whole)
        empty.__path__ = [str(Path(folder, "special")) for folder in scipy.submodule_search_locations or ()]
        sys.modules[whole] = empty
        try:
            module = importlib.import_module(f"{whole}._ufuncs")
            if hasattr(module, "ndtr") and hasattr(module, "ndtri"):
                return module
        except ImportError:
            pass
        finally:
            del sys.modules[whole]
    return importlib.import_module(whole)


_functions = _compiled()
