"""Checks of an environment's arguments, actions and rewards: one `UsageError` each."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return an argument as an int; raise a `UsageError` unless it is a whole number from low to high."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= int(value) <= high:
        raise UsageError(f"{name}: got {value!r}, needs a whole number from {low} to {high:,}")
    return int(value)


def one_of(name: str, value: Any, known: Sequence[str]) -> str:
    """Return an argument; raise a `UsageError` unless it is one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise UsageError(f"{name}: unknown {value!r}; known: {', '.join(known)}")
    return value


def finite_numbers(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return values as an array; raise a `UsageError` unless they are finite real numbers of a shape."""
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        raise UsageError(f"{name}: got rows of different lengths, needs shape {shape}") from None
    if array.dtype.kind not in "fiub":
        raise UsageError(f"{name}: got values of type {array.dtype.name}, needs real numbers")
    if array.shape != shape:
        raise UsageError(f"{name}: got shape {array.shape}, needs {shape}")
    if not np.isfinite(array).all():
        raise UsageError(f"{name}: got {np.count_nonzero(~np.isfinite(array))} values that are not finite")
    return np.asarray(array, dtype=np.float64)
