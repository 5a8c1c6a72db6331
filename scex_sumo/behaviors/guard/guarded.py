"""Guard around any of our models, a safe-speed bound: the planned way stays, the speed on it comes down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.guard.conflicts import Holds, find_holds
from scex_sumo.behaviors.guard.profile import GuardProfile
from scex_sumo.behaviors.guard.ways import PlannedWays, planned_paths
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who

LAST_GAP_M = 0.2  # the nearest that hard braking aims for
LEAP_MPS2 = 6.0  # who is to gain speed faster than that, or more way than this in a step, would leap
LEAP_M = 0.1
LEAST_CHANGE_MPS = 1e-6  # a bound that lowers a speed by less does not count


def safe_speed(
    gap_m: FloatArray, leader_speed_mps: FloatArray, *, deceleration: float, reaction_time: float
) -> FloatArray:
    """Highest speed from which a vehicle that reacts after a time still stops behind its leader.

    v_safe = -bτ + √((bτ)² + v_leader² + 2·b·gap); the leader may brake with b at any moment.

    Args:
        gap_m: (n,) free way to the leader; may be negative.
        leader_speed_mps: (n,) at least 0.
        deceleration: b, m/s², of both.
        reaction_time: τ, s.

    Returns:
        (n,) m/s, at least 0.

    Source: Krauss 1998.
    """
    lag = deceleration * reaction_time
    square = lag**2 + leader_speed_mps**2 + 2 * deceleration * gap_m
    speed: FloatArray = np.sqrt(np.maximum(square, 0.0)) - lag
    return np.maximum(speed, 0.0)


@runtime_checkable
class Steers(Protocol):
    """A model that can steer clear of who is beside it."""

    def clear_of_others(self) -> Behavior:
        """The same model, one that does."""
        ...


class Guarded:
    """Any model, driven no faster than it could stop for others.

    The plan's way is kept; along it the speed stays below `safe_speed` of every leader in the swept corridor
    and of every crossing that another vehicle reaches first. A model that `Steers` goes a way that keeps
    clear of who is beside it. What the others will do is taken from the history alone, so a plan does not
    depend on who else plans in the same call.
    """

    def __init__(self, model: Behavior, profile: GuardProfile | None = None) -> None:
        """Wrap a model.

        Args:
            profile: the guard's parameters; None takes the defaults.
        """
        self.model = model.clear_of_others() if isinstance(model, Steers) else model
        self.profile = profile or GuardProfile()

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """The model's plan, slowed down where it must be; see `Behavior.plan`."""
        made = self.model.plan(history, road, who, rng)
        return slowed(made, history, road, who, self.profile) if len(who) else made


def slowed(plan: Plan, history: SceneHistory, road: Road, who: Who, profile: GuardProfile) -> Plan:
    """A plan re-timed along its own way so that its vehicles could always stop.

    Args:
        plan: (n, H).

    Returns:
        (n, H); rows that need no change are the very same numbers.
    """
    paths = planned_paths(plan, history, who, profile)
    holds = find_holds(paths, history, road, who, profile).joined_by(_leaping(paths))
    if not len(holds.row):
        return plan
    speed, arc, changed = _timed(paths, holds, profile)
    rows = np.flatnonzero(changed)
    if not len(rows):
        return plan
    slow = plan.map(np.copy)
    slow.assign(rows, paths.poses(rows, arc[rows], speed[rows]))
    return replace(plan, **vars(slow))


def _leaping(paths: PlannedWays) -> IntArray:
    """Vehicles whose plan does not start from where they are: a model that takes no account of being slowed.

    Such as one that keeps the speed it had, or repeats a recording.
    """
    v = paths.start_speed
    fast = paths.speed[:, 0] > v + LEAP_MPS2 * STEP_S
    far = paths.arc[:, 1] > (v + LEAP_MPS2 * STEP_S / 2) * STEP_S + LEAP_M
    return np.flatnonzero(fast | far)


def _timed(
    paths: PlannedWays, holds: Holds, profile: GuardProfile
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """(n, H) speeds and arc lengths under all bounds, and (n,) which vehicles are held back at all."""
    speed, arc = paths.speed.copy(), paths.arc[:, 1:].copy()
    changed = np.zeros(len(speed), dtype=np.bool_)
    mine, first = np.unique(holds.row, return_index=True)  # rows are sorted
    s, v = np.zeros(len(mine)), paths.start_speed[mine]
    # Steps first: what is done with all vehicles at once is a long row in memory.
    planned, arcs = paths.speed[mine].T.copy(), paths.arc[mine].T.copy()
    way, held = np.diff(arcs, axis=0), np.zeros(len(mine), dtype=np.bool_)
    count = np.diff(np.append(first, len(holds.row)))
    gain = np.diff(planned, axis=0, prepend=v[None]) / STEP_S
    gain = np.maximum(np.where(gain > LEAP_MPS2, 0.0, gain), profile.release_acceleration)
    timed = np.empty((2, *planned.shape))
    for step, (speed_then, way_then) in enumerate(zip(planned, way, strict=True)):
        bound, braking = _bounds(holds, profile, step, np.repeat(s, count), np.repeat(v, count), first)
        wanted = np.minimum(speed_then, bound)
        wanted = np.minimum(np.maximum(wanted, v - braking * STEP_S), v + gain[step] * STEP_S)
        following = np.maximum(np.minimum(wanted, speed_then), 0.0)
        moved = (v + following) * (STEP_S / 2)
        held |= (following < speed_then - LEAST_CHANGE_MPS) | (moved < way_then - LEAP_M)
        s = np.where(held, s + np.minimum(moved, way_then), arcs[step + 1])
        v = following
        timed[0, step], timed[1, step] = v, s
    changed[mine] = held
    speed[mine], arc[mine] = timed[0].T, timed[1].T
    return speed, arc, changed


def _bounds(
    holds: Holds, profile: GuardProfile, step: int, s: FloatArray, v: FloatArray, first: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Speed limit at the end of a step and braking limit now, of each vehicle that has a hold.

    Args:
        step: steps since the present.
        s: (P,) where the held vehicle is, m along its plan.
        v: (P,) its speed, m/s.
        first: index of each vehicle's first hold.
    """
    t = step * STEP_S
    gone = np.minimum(t, holds.stop_time)
    position = holds.position + holds.speed * gone - 0.5 * holds.deceleration * gone**2
    leader = np.maximum(holds.speed - holds.deceleration * gone, 0.0)
    gap = position - s
    b, tau = profile.comfort_deceleration, profile.reaction_time
    follow = safe_speed(gap - profile.minimum_gap, leader, deceleration=b, reaction_time=tau)
    closing = np.where(v > leader, v**2 - leader**2, 0.0)
    braking = np.where(holds.firm, closing, 0.0)
    braking /= 2 * np.maximum(gap - LAST_GAP_M, LAST_GAP_M)
    bound = np.where(gap < 0, 0.0, follow)
    early = np.flatnonzero((holds.enter > t) & (holds.speed > 0))
    if len(early):
        # Who will follow another one that is not there yet is not to be at the place before it.
        entry = holds.position[early] + holds.speed[early] * holds.enter[early]
        ahead, left = entry - s[early], np.maximum(holds.enter[early] - t, STEP_S)
        wait = safe_speed(
            ahead - profile.minimum_gap, np.zeros_like(ahead), deceleration=b, reaction_time=tau
        )
        wait = np.maximum(wait, np.maximum(ahead, 0.0) / left)
        # Stopping before the place would do, and so would getting there no sooner than the other one.
        stop = v[early] ** 2 / (2 * np.maximum(ahead - LAST_GAP_M, LAST_GAP_M))
        late = 2 * np.maximum(v[early] - np.maximum(ahead, 0.0) / left, 0.0) / left
        braking[early] = np.where(holds.firm[early], np.minimum(stop, late), 0.0)
        braking[early] = np.minimum(braking[early], profile.yield_deceleration)
        bound[early] = np.minimum(follow[early], wait)
    active = holds.until > t
    lowest = np.minimum.reduceat(np.where(active, bound, np.inf), first)
    hardest = np.maximum.reduceat(np.where(active, braking, 0.0), first)
    return lowest, np.clip(hardest, b, profile.max_deceleration)
