"""Errors of users' own code, with its line."""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import OwnCodeError, ScexError, reason_of

MAX_REASON = 200  # characters
_PACKAGE = Path(__file__).resolve().parents[1]
_STANDARD = Path(traceback.__file__).resolve().parent  # the standard library


def own_error_reason(error: BaseException) -> str:
    """Describe an error of a user's model or metric, with the line of the user's own code."""
    if isinstance(error, ScexError):
        return _short(reason_of(error))
    frame = _own_frame(error)
    place = f" ({Path(frame.filename).name}, line {frame.lineno})" if frame is not None else ""
    return _short(f"raised {reason_of(error)}") + place


_twice = ContextVar("twice", default=False)


@contextmanager
def calling_twice() -> Iterator[None]:
    """Call each function of the user's twice, see `own_call`; results that differ are an error."""
    token = _twice.set(True)
    try:
        yield
    finally:
        _twice.reset(token)


def alike(one: Any, other: Any) -> bool:
    """Return whether two results hold the same: arrays, dataclasses, containers; NaN is like NaN."""
    import numpy as np

    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        return all(alike(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, dict):
        return list(one) == list(other) and alike([*one.values()], [*other.values()])
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(alike, one, other))
    return bool(one == other or one != one)


def own_call(
    said: str, function: Callable[..., Any], needs: type = object, *, error: type[ScexError] = OwnCodeError
) -> Callable[..., Any]:
    """Return a function of the user's whose errors are one line.

    Args:
        said: what it is, for messages, e.g. ``map format polyline: read``.
        needs: type of what it has to return; a list is made of any iterable.

    Raises:
        OwnCodeError: it raised, or returned something else; or another ``error``. Those of this package pass.
    """

    def made_by(*arguments: Any, **options: Any) -> Any:
        result = function(*arguments, **options)
        return list(result) if needs is list else result

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        try:
            result = again = made_by(*arguments, **options)
            if _twice.get():
                again = made_by(*arguments, **options)
        except ScexError:
            raise
        except (Exception, SystemExit) as cause:
            raise error(f"{said} {own_error_reason(cause)}") from cause
        if result is not again and not alike(result, again):
            raise error(f"{said} returned something else when called again: draw nothing, keep nothing")
        if not isinstance(result, needs):
            raise error(f"{said} returned {type(result).__name__}, needs {needs.__name__}")
        return result

    return call


def _own_frame(error: BaseException) -> traceback.FrameSummary | None:
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith("<")]
    frames = [f for f in frames if _PACKAGE not in Path(f.filename).parents]
    installed = [f for f in frames if "site-packages" in Path(f.filename).parts]
    written = [f for f in frames if f not in installed and _STANDARD not in Path(f.filename).parents]
    if written:
        return written[-1]
    # In code of an installed package, the package's file comes first, its libraries after it.
    return next((f for f in reversed(installed) if f.filename == installed[0].filename), None)


def _short(words: str) -> str:
    return words if len(words) <= MAX_REASON else f"{words[: MAX_REASON - 3]}..."
