"""Compiled modules of scipy, without all that their packages load beside them."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def compiled(package: str, module: str, *names: str) -> ModuleType | None:
    """A compiled module by itself; None where it, or one of the names in it, is not to be had so.

    What scipy's packages have in Python takes as long to import as a hundred children to run. An empty one
    stands in its place while the module is imported: to be called while modules are imported, before threads
    import too.

    Args:
        package: ``scipy.special``.
        module: the name of the module in it.
        names: what is wanted of it.
    """
    if package in sys.modules or (scipy := importlib.util.find_spec("scipy")) is None:
        return None
    empty = ModuleType(package)
    inner = package.partition(".")[2]
    empty.__path__ = [str(Path(folder, inner)) for folder in scipy.submodule_search_locations or ()]
    sys.modules[package] = empty
    try:
        found = importlib.import_module(f"{package}.{module}")
    except ImportError:
        return None
    finally:
        del sys.modules[package]
    return found if all(hasattr(found, name) for name in names) else None
