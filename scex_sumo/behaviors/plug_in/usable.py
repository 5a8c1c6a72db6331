"""Plan check: what is wrong with a plan of a user's own model, and where its author finds the cause."""

from __future__ import annotations

import inspect
import traceback
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.plug_in.single import SingleVehicle
from scex_sumo.errors import ScexError, reason_of
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who

JUMP_M = 5.0  # off the motion so far, within one step: 500 m/s², which no vehicle can do
LONGEST_REASON = 200
STATES = ("x", "y", "heading", "speed")
_PACKAGE = Path(__file__).resolve().parents[2]
_STANDARD = Path(traceback.__file__).resolve().parent  # the standard library


def checked_shape(made: Any, count: int) -> Plan:
    """The first 30 steps of what a model returned, as arrays of our own.

    Args:
        count: number of vehicles n that it was asked for.

    Raises:
        ScexError: it is no plan, of another number of vehicles, or too short.
    """
    parts = {}
    for key in STATES:
        if not hasattr(made, key):
            raise ScexError(f"returned {type(made).__name__}, which has no {key}; needs a scex_sumo.Plan")
        values = np.asarray(getattr(made, key), dtype=np.float64)
        if values.ndim != 2 or values.shape[0] != count or values.shape[1] < PLAN_STEPS:
            raise ScexError(
                f"plan.{key} has shape {values.shape}, needs ({count}, {PLAN_STEPS}) or more steps"
            )
        parts[key] = values[:, :PLAN_STEPS].copy()
    return Plan(**parts, fallback=getattr(made, "fallback", None), reasons=getattr(made, "reasons", ()))


def wrong_with(made: Plan, history: SceneHistory, who: Who) -> list[str]:
    """(n) what makes a vehicle's plan unusable, empty where it can be driven.

    It must be finite, and no state may lie more than 5 m from where the motion up to it leads; the first
    one, from where the vehicle's present speed and heading lead.

    Args:
        made: (n, 30).
    """
    reasons = [""] * len(who)
    finite = np.stack([np.isfinite(getattr(made, key)).all(axis=1) for key in STATES])
    for row in np.flatnonzero(~finite.all(axis=0)):
        reasons[row] = f"plan.{STATES[int(np.argmin(finite[:, row]))]} is not finite"
    off = _off_the_motion(made, history, who)
    for row in np.flatnonzero(finite.all(axis=0) & (off > JUMP_M).any(axis=1)):
        step = int(np.argmax(off[row] > JUMP_M))
        where = "starts" if step == 0 else f"jumps at step {step + 1} to"
        reasons[row] = f"plan {where} {off[row, step]:.1f} m from where the vehicle's motion leads"
    return reasons


def _off_the_motion(made: Plan, history: SceneHistory, who: Who) -> FloatArray:
    """(n, H) distance of each state from the straight continuation of the motion before it, m."""
    own = history.now[who.child, who.vehicle]
    step = own.speed * STEP_S
    x = np.concatenate([(own.x - step * np.cos(own.heading))[:, None], own.x[:, None], made.x], axis=1)
    y = np.concatenate([(own.y - step * np.sin(own.heading))[:, None], own.y[:, None], made.y], axis=1)
    with np.errstate(invalid="ignore", over="ignore"):
        off: FloatArray = np.hypot(np.diff(x, 2, axis=1), np.diff(y, 2, axis=1))
    return off


def reason_in_model(error: BaseException) -> str:
    """Reason of an error of a model, with the line of the model's own code where it was raised."""
    if isinstance(error, ScexError):
        return _short(reason_of(error))
    frame = _authors_frame(error)
    place = f" ({Path(frame.filename).name}, line {frame.lineno})" if frame is not None else ""
    return _short(f"raised {reason_of(error)}") + place


def _authors_frame(error: BaseException) -> traceback.FrameSummary | None:
    """Where a model's author looks first: the innermost frame that is neither ours nor a library's."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith("<")]
    frames = [f for f in frames if _PACKAGE not in Path(f.filename).parents]
    installed = [f for f in frames if "site-packages" in Path(f.filename).parts]
    own = [f for f in frames if f not in installed and _STANDARD not in Path(f.filename).parents]
    if own:
        return own[-1]
    # A model of an installed package: its own file comes first, what it calls after it.
    return next((f for f in reversed(installed) if f.filename == installed[0].filename), None)


def _short(words: str) -> str:
    return words if len(words) <= LONGEST_REASON else f"{words[: LONGEST_REASON - 3]}..."


def where_from(model: Any) -> str:
    """``class Driver of /path/driver.py``: where to look for a model."""
    made = _author(model)
    if hasattr(made, "file"):
        return f"the file {made.file}"
    kind = "function" if inspect.isfunction(made) else "class"
    file = source_file(model)
    return f"{kind} {made.__qualname__} of {made.__module__ if file is None else file}"


def source_file(model: Any) -> Path | None:
    """The file that a model comes from: its own, or that of its class or function; None without one."""
    made = _author(model)
    if hasattr(made, "file"):
        return Path(made.file)
    try:
        return Path(inspect.getfile(made))
    except (OSError, TypeError):
        return None


def _author(model: Any) -> Any:
    """What a user wrote: a class, a function, or what stands for a file."""
    inner = getattr(model, "function", model.model if isinstance(model, SingleVehicle) else model)
    inner = inner.func if isinstance(inner, partial) else inner
    return inner if inspect.isfunction(inner) or hasattr(inner, "file") else type(inner)
