"""Guard around a model: a safe-speed bound along the planned way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import BatchBehavior, Sight, clear_of_others, sight_of
from scex_sumo.humans.guard.conflicts import SAFE_S, StopLines, find_stop_lines
from scex_sumo.humans.guard.corridors import GuardProfile, PlannedWays, planned_paths
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

LAST_GAP_M = 0.2  # that hard braking aims for
MORE_THAN_NEEDED = 1.5  # braking limit, times the least braking that is enough
LEAP_MPS2 = 6.0  # a plan that gains speed faster than this, or more way in a step, leaps
LEAP_M = 0.1
MIN_CHANGE_MPS = 1e-6  # a bound that lowers a speed by less does not count

Bounds: TypeAlias = Callable[[StopLines, IntArray, int, FloatArray, FloatArray], FloatArray]
"""Return the highest speed (n,) of vehicles with stop lines after a step, m/s, which braking can reach.

Arguments: the stop lines; the first line (n,) of each vehicle; the step; place (P,), m along its plan, and
speed (P,), m/s, of each line's vehicle.
"""


def safe_speed(
    gap_m: FloatArray, leader_speed_mps: FloatArray, *, deceleration: float, reaction_time: float
) -> FloatArray:
    """Return (n,) speeds from which vehicles stop behind leaders that brake with b, m/s.

    v_safe = -bτ + √((bτ)² + v_leader² + 2·b·gap).

    Args:
        gap_m: (n,) free way; may be negative.
        deceleration: b, m/s².
        reaction_time: τ, s.

    Source: Krauss 1998.
    """
    lag = deceleration * reaction_time
    square = lag**2 + leader_speed_mps**2 + 2 * deceleration * gap_m
    speed: FloatArray = np.sqrt(np.maximum(square, 0.0)) - lag
    return np.maximum(speed, 0.0)


class Guarded:
    """A model whose vehicles drive slowly enough to stop for others.

    The way of the plan stays. Speeds stay below `safe_speed` for leaders in the swept corridor and for
    crossings that others reach first. Braking is as hard as needed, and gentle for others that are missed
    with constant velocity and heading. A model with
    ``clear_of_others`` also steers away from vehicles beside it.
    """

    def __init__(self, model: BatchBehavior, profile: GuardProfile | None = None) -> None:
        self.inner: BatchBehavior = clear_of_others(model)
        self.profile = profile or GuardProfile()

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on: the guard sees all vehicles."""
        return None if sight_of(self.inner) is None else "everyone"

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the model's plan, slowed down where necessary."""
        plan = self.inner.plan(history, road, who, rng)
        return slowed(plan, history, road, who, self.profile) if len(who) else plan


def slowed(plan: Plan, history: SceneHistory, road: Road, who: VehicleIndex, profile: GuardProfile) -> Plan:
    """Re-time a plan (n, H) along its way so that vehicles can always stop."""
    return retimed(plan, history, road, who, profile, partial(_bounds, profile=profile))


def retimed(
    plan: Plan,
    history: SceneHistory,
    road: Road,
    who: VehicleIndex,
    profile: GuardProfile,
    bounds: Bounds,
) -> Plan:
    """Re-time a plan (n, H) along its way under the bounds of its stop lines."""
    paths = planned_paths(plan, history, who, profile)
    holds = find_stop_lines(paths, history, road, who, profile).joined_by(_leaping(paths))
    if not len(holds.row):
        return plan
    speed, arc, changed = _timed(paths, holds, profile, bounds)
    rows = np.flatnonzero(changed)
    if not len(rows):
        return plan
    slow = plan.map(np.copy)
    slow.assign(rows, paths.poses(rows, arc[rows], speed[rows]))
    return replace(plan, **vars(slow))


def _leaping(paths: PlannedWays) -> IntArray:
    """Return vehicles whose plan leaps, as a replay does that was slowed down."""
    v = paths.start_speed
    fast = paths.speed[:, 0] > v + LEAP_MPS2 * STEP_S
    far = paths.arc[:, 1] > (v + LEAP_MPS2 * STEP_S / 2) * STEP_S + LEAP_M
    return np.flatnonzero(fast | far)


def _timed(
    paths: PlannedWays, holds: StopLines, profile: GuardProfile, bounds: Bounds
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return speeds and arc lengths (n, H), and (n,) which vehicles are slowed."""
    speed, arc = paths.speed.copy(), paths.arc[:, 1:].copy()
    changed = np.zeros(len(speed), dtype=np.bool_)
    rows, first = np.unique(holds.row, return_index=True)  # rows are sorted
    s, v = np.zeros(len(rows)), paths.start_speed[rows]
    # Vehicles are the last axis, so that operations run along memory.
    planned, arcs = paths.speed[rows].T.copy(), paths.arc[rows].T.copy()
    way, held = np.diff(arcs, axis=0), np.zeros(len(rows), dtype=np.bool_)
    count = np.diff(np.append(first, len(holds.row)))
    gain = np.diff(planned, axis=0, prepend=v[None]) / STEP_S
    gain = np.maximum(np.where(gain > LEAP_MPS2, 0.0, gain), profile.release_acceleration)
    timed = np.empty((2, *planned.shape))
    for step, (speed_then, way_then) in enumerate(zip(planned, way, strict=True)):
        bound = bounds(holds, first, step, np.repeat(s, count), np.repeat(v, count))
        wanted = np.minimum(np.minimum(speed_then, bound), v + gain[step] * STEP_S)
        following = np.maximum(np.minimum(wanted, speed_then), 0.0)
        moved = (v + following) * (STEP_S / 2)
        held |= (following < speed_then - MIN_CHANGE_MPS) | (moved < way_then - LEAP_M)
        s = np.where(held, s + np.minimum(moved, way_then), arcs[step + 1])
        v = following
        timed[0, step], timed[1, step] = v, s
    changed[rows] = held
    speed[rows], arc[rows] = timed[0].T, timed[1].T
    return speed, arc, changed


def _bounds(
    holds: StopLines, first: IntArray, step: int, s: FloatArray, v: FloatArray, *, profile: GuardProfile
) -> FloatArray:
    """Return the guard's `Bounds`."""
    t = step * STEP_S
    position, leader = line_motion(holds, t)
    gap = position - s
    safe = partial(safe_speed, deceleration=profile.comfort_deceleration, reaction_time=profile.reaction_time)
    bound = np.where(gap < 0, 0.0, safe(gap - profile.minimum_gap, leader))
    early = np.flatnonzero((holds.enter > t) & (holds.speed > 0))
    if len(early):
        # It must not reach the place before the vehicle that it will follow.
        ahead = holds.position[early] + holds.speed[early] * holds.enter[early] - s[early]
        wait = safe(ahead - profile.minimum_gap, np.zeros_like(ahead))
        wait = np.maximum(wait, np.maximum(ahead, 0.0) / np.maximum(holds.enter[early] - t, STEP_S))
        bound[early] = np.minimum(bound[early], wait)
    mild = min(profile.safe_deceleration, profile.comfort_deceleration)
    most = np.where(holds.firm, profile.max_deceleration, profile.comfort_deceleration)
    most[early] = np.minimum(most[early], profile.yield_deceleration)
    limit = np.clip(MORE_THAN_NEEDED * needed_braking(holds, t, s, v), mild, most)
    # Behind a vehicle abreast that comes over later, it falls back gently.
    abreast = (holds.enter > 0) & (holds.position < 0)
    limit = np.where((holds.safe | abreast) & (t < SAFE_S / 2), mild, limit)
    allowed = np.where(holds.until > t, np.maximum(bound, v - limit * STEP_S), np.inf)
    lowest: FloatArray = np.minimum.reduceat(allowed, first)
    return lowest


def needed_braking(
    holds: StopLines, t: float, s: FloatArray, v: FloatArray, entry_gap_m: float = LAST_GAP_M
) -> FloatArray:
    """Return (P,) constant decelerations with which vehicles just stay behind their stop lines, m/s².

    Args:
        t: s since the plan began.
        s: (P,) places of vehicles, m along their plans.
        v: (P,) m/s.
        entry_gap_m: to a vehicle that enters later.
    """
    position, leader = line_motion(holds, t)
    room = 2 * np.maximum(position - s - LAST_GAP_M, LAST_GAP_M)
    needed: FloatArray = np.maximum(v - leader, 0.0) ** 2 / room
    brakes = np.flatnonzero((holds.deceleration > 0) & (leader > 0))
    to_stop = leader[brakes] ** 2 / holds.deceleration[brakes]
    needed[brakes] = np.maximum(needed[brakes], v[brakes] ** 2 / (room[brakes] + to_stop))
    early = np.flatnonzero((holds.enter > t) & (holds.speed > 0))
    ahead = holds.position[early] + holds.speed[early] * holds.enter[early] - s[early] - entry_gap_m
    # It is enough to stop before the place, or to arrive no sooner than the other one.
    stop = v[early] ** 2 / (2 * np.maximum(ahead, LAST_GAP_M))
    left = np.maximum(holds.enter[early] - t, STEP_S)
    needed[early] = np.minimum(stop, arriving_later(ahead, left, v[early]))
    return needed


def arriving_later(way: FloatArray, time_s: FloatArray, v: FloatArray) -> FloatArray:
    """Return (P,) constant decelerations with which vehicles come a way, m, in no less than a time, m/s².

    On a short way they stop at its end before; beyond the place it no longer matters.
    """
    late = 2 * np.maximum(v - np.maximum(way, 0.0) / time_s, 0.0) / time_s
    stops = (way > 0) & (2 * way < v * time_s)
    return np.where(stops, v**2 / (2 * np.maximum(way, LAST_GAP_M)), late)


def line_motion(holds: StopLines, t: float) -> tuple[FloatArray, FloatArray]:
    """Return positions (P,) m and speeds (P,) m/s of stop lines at a time."""
    gone = np.minimum(t, holds.stop_time)
    position: FloatArray = holds.position + holds.speed * gone - 0.5 * holds.deceleration * gone**2
    return position, np.maximum(holds.speed - holds.deceleration * gone, 0.0)
