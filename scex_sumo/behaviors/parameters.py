"""Checks shared by the parameter classes of the models."""

from __future__ import annotations

import math
from typing import Any

from scex_sumo.errors import UsageError


def check_positive(parameters: Any, *names: str, zero: bool = False) -> None:
    """Raise a `UsageError` unless the named attributes are finite and positive (or zero, where allowed)."""
    for name in names:
        value = getattr(parameters, name)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value < 0 or (value == 0 and not zero):
            wanted = "a number of at least 0" if zero else "a positive number"
            raise UsageError(f"{name}: got {value!r}; give {wanted}")


def check_path(path: Any) -> None:
    """Raise a `UsageError` unless a path is an index, ``straight``, ``random``, lane ids, or points."""
    if isinstance(path, bool):
        raise UsageError(f"path: got {path!r}; give an index from left to right, straight, or random")
    if isinstance(path, int) or path in ("straight", "random"):
        return
    if isinstance(path, tuple) and path:
        if all(isinstance(p, int) for p in path):
            return
        points = all(isinstance(p, tuple) and len(p) == 2 and all(map(math.isfinite, p)) for p in path)
        if points and len(path) >= 2:
            return
    raise UsageError(
        f"path: got {path!r}; give an index from left to right, straight, random, a tuple of lane ids, "
        "or a tuple of at least two (x, y) points"
    )
