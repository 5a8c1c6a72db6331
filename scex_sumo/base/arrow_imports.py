"""Import of Arrow without pandas, which Arrow would load with its first array, in a third of a second.

Arrow loads pandas all the same once a table is converted to it or from it.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ARROW, PANDAS = "pyarrow", "pandas"


def import_arrow_alone() -> None:
    """Let this process import Arrow without pandas; nothing changes if it has either already."""
    if not {ARROW, PANDAS} & sys.modules.keys():
        sys.meta_path.insert(0, _ArrowFinder())


class _ArrowFinder:
    """Finder of Arrow, used once, which lets it look for pandas in vain after its import."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != ARROW:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        loader: Any = None if spec is None else spec.loader
        if loader is not None:
            execute = loader.exec_module
            loader.exec_module = lambda module: _execute_alone(execute, module)
        return spec


def _execute_alone(execute: Any, module: ModuleType) -> None:
    execute(module)
    if PANDAS in sys.modules:
        return
    hidden = _NoPandas()
    sys.meta_path.insert(0, hidden)
    try:
        module.array([0])  # Arrow looks for pandas here, once
    finally:
        sys.meta_path.remove(hidden)


class _NoPandas:
    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        if name == PANDAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
