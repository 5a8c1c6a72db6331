"""Needed braking: the least constant deceleration from now on with which a vehicle avoids another one.

The other one goes on as it does: a braking one brakes to rest, an accelerating one accelerates for a second,
then keeps its speed. Both keep their ways.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.conflicts.driven import HORIZON_S, NODES, DrivenPaths, Shared
from scex_sumo.scene import STEP_S

MOST_MPS2: Final = 20.0
"""Needed braking that stands for all beyond it, and for a contact that no braking avoids."""

_MEAN_STEPS = 5
_STEP_S = 0.2
_TIMES_S = np.arange(0.0, HORIZON_S + 1e-9, _STEP_S)[1:]
_ACCELERATES_S = 1.0
_SLACK_M = 1e-6  # of rounding, where what is out of reach is left out


def needed_braking(
    ways: DrivenPaths, shared: Shared, acceleration: FloatArray, steps: IntArray
) -> FloatArray:
    """Return (n, S) needed braking of the own vehicles at steps (S,) of T, m/s²; 0 where none is needed.

    ``acceleration``: (R, T) of all vehicles, m/s².
    """
    needed = np.zeros((len(shared.own), len(steps)))
    row, at = np.nonzero(_in_reach(ways, shared, acceleration, steps))
    needed[row, at] = _needed(ways, shared, acceleration, row, steps[at])
    return needed


def _needed(
    ways: DrivenPaths, shared: Shared, acceleration: FloatArray, row: IntArray, step: IntArray
) -> FloatArray:
    """Return the needed braking (m,) of the own vehicles of rows (m,) at steps (m,)."""
    own, other = (shared.own[row], step), (shared.other[row], step)
    speed = ways.states.speed[own][:, None]
    gone = ways.arc[other][:, None] + distance(ways.states.speed[other], acceleration[other])
    enter, leave = (values - ways.arc[own][:, None] for values in _blocked(ways, shared, row, gone))
    unbraked = speed * _TIMES_S
    contact = (unbraked >= enter) & (unbraked <= leave)  # False where nothing is blocked
    since = np.logical_or.accumulate(contact, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        moving = 2 * (unbraked - enter) / _TIMES_S**2
        stopped = speed**2 / (2 * enter)
    needed = np.where(enter >= unbraked / 2, moving, stopped)
    needed = np.where(enter <= 0, MOST_MPS2, np.clip(needed, 0.0, MOST_MPS2))
    needed = np.where(since & np.isfinite(enter), needed, 0.0).max(axis=-1)
    # One that the other comes up to from behind cannot let it pass.
    led = ((unbraked > leave) & ~since).any(axis=-1)
    return np.asarray(np.where(led & since[..., -1], MOST_MPS2, needed))


def _in_reach(ways: DrivenPaths, shared: Shared, acceleration: FloatArray, steps: IntArray) -> BoolArray:
    """Return whether (n, S) both may reach the shared stretch in time; one that reverses may always."""
    own, other = (shared.own[:, None], steps), (shared.other[:, None], steps)
    reverses = np.minimum(ways.states.speed[own], ways.states.speed[other]) < 0
    known = ~np.isnan(shared.enter)
    first, last = np.argmax(known, axis=1), NODES - 1 - np.argmax(known[:, ::-1], axis=1)
    spacing = ways.spacing[shared.other][:, None]
    after = ways.arc[other] + distance(ways.states.speed[other], acceleration[other], _TIMES_S[-1:])[..., 0]
    begin, end = (first[:, None] - 1) * spacing - _SLACK_M, (last[:, None] + 1) * spacing + _SLACK_M
    meets = (after >= begin) & (ways.arc[other] <= end)
    enter = np.fmin.reduce(shared.enter, axis=1)[:, None] - _SLACK_M
    leave = np.fmax.reduce(shared.leave, axis=1)[:, None] + _SLACK_M
    reached = ways.arc[own] + ways.states.speed[own] * HORIZON_S
    return np.asarray(reverses | (meets & (reached >= enter) & (ways.arc[own] <= leave)))


def both_braking(ways: DrivenPaths, shared: Shared, steps: IntArray) -> FloatArray:
    """Return (n, S) deceleration of both vehicles with which two that face each other stop in time, m/s².

    0 where the other one is not on the way ahead, `MOST_MPS2` where they touch already.
    """
    own, other = (shared.own[:, None], steps), (shared.other[:, None], steps)
    enter = _blocked(ways, shared, np.arange(len(shared.own)), ways.arc[other])[0] - ways.arc[own]
    speed = ways.states.speed
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (speed[own] ** 2 + speed[other] ** 2) / (2 * enter)
    needed = np.where(enter > 0, np.minimum(needed, MOST_MPS2), MOST_MPS2)
    return np.asarray(np.where(np.isnan(enter), 0.0, needed))


def recent_acceleration(speed: FloatArray) -> FloatArray:
    """Return (R, T) mean acceleration over the last half second, m/s², by speeds; 0 at first."""
    acceleration = np.zeros_like(speed)
    acceleration[:, _MEAN_STEPS:] = (speed[:, _MEAN_STEPS:] - speed[:, :-_MEAN_STEPS]) / (
        _MEAN_STEPS * STEP_S
    )
    return acceleration


def distance(speed: FloatArray, acceleration: FloatArray, times_s: FloatArray = _TIMES_S) -> FloatArray:
    """Return the (..., K) way of vehicles that go on as they do, by times (K,), m."""
    speed, acceleration = speed[..., None], acceleration[..., None]
    rest = np.where(acceleration < 0, speed / np.maximum(-acceleration, 1e-9), np.inf)
    braked = np.minimum(times_s, rest)
    faster = np.minimum(times_s, _ACCELERATES_S)
    slowing = speed * braked + acceleration * braked**2 / 2
    growing = speed * times_s + acceleration * (faster * times_s - faster**2 / 2)
    return np.asarray(np.where(acceleration < 0, slowing, growing))


def _blocked(
    ways: DrivenPaths, shared: Shared, row: IntArray, arc: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the stretches (m, K) of rows (m,) that are blocked while the others are at an arc length, m."""
    node = np.clip(arc / ways.spacing[shared.other[row]][:, None], 0, NODES - 1)
    below = np.minimum(node.astype(np.int64), NODES - 2)
    share, flat = node - below, NODES * row[:, None] + below
    ends = []
    for values, widest in ((shared.enter, np.fmin), (shared.leave, np.fmax)):
        a, b = values.take(flat), values.take(flat + 1)
        between = (1 - share) * a + share * b
        ends.append(np.where(np.isnan(between), widest(a, b), between))
    return ends[0], ends[1]
