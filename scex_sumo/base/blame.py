"""Errors of users' own code, with its line."""

from __future__ import annotations

import traceback
from pathlib import Path

from scex_sumo.base.errors import ScexError, reason_of

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
