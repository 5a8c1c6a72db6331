"""Kept roads: what a map was read to stays in the user's cache for the next run on the same map.

It is kept under a hash of the map and of the very modules that read it.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.files import kept, our_modules
from scex_sumo.road import Area, Georeference, Lane, Loss, Marking, Regulation, Road

_PARTS = (Area, Georeference, Lane, Loss, Marking, Regulation, Road)
_NUMPY = ("numpy._core.numeric", "numpy.core.numeric")  # from NumPy 2 on, and before
_KNOWN = {
    *(
        (part.__module__, part.__name__)
        for part in (Area, Georeference, Lane, Loss, Marking, Regulation, Road)
    ),
    *((module, "_frombuffer") for module in _NUMPY),
    *(("numpy", "dtype"), ("numpy", "ndarray"), ("pathlib", "PosixPath")),
}


def kept_road(path: Path, read: Callable[[], Road], *settings: object) -> Road:
    """What ``read`` gives, from the cache where it has it.

    Args:
        path: the map.
        read: reads it.
        settings: what else decides on the road.
    """
    try:
        content = path.read_bytes()
    except OSError:  # the reader's to report
        return read()
    made_by = repr((np.__version__, version("lanelet2"), path.name, settings)).encode()
    made = kept("roads", made_by + our_modules() + content, lambda: pickle.dumps(read(), protocol=5))
    try:
        road: Road = _Reader(io.BytesIO(made)).load()
    except pickle.UnpicklingError:
        return read()
    return road


class _Reader(pickle.Unpickler):
    """Reads roads and nothing else, whoever wrote into the cache."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _KNOWN:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a road")
        return super().find_class(module, name)
