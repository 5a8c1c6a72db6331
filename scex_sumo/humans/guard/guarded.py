"""Guard: it keeps the way of a plan and lowers the speed for conflicts, as early and as hard as people do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior, Driver, Sight, clear_of_others, declared
from scex_sumo.humans.guard.conflicts import StopLines, find_stop_lines
from scex_sumo.humans.guard.corridors import PlannedWays, planned_paths
from scex_sumo.humans.parameters import HumanParameters, human_parameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

LAST_GAP_M = 0.2  # that hard braking aims for
LEAP_MPS2 = 6.0  # a plan that gains speed faster than this, or more way in a step, leaps
LEAP_M = 0.1
MIN_CHANGE_MPS = 1e-6  # a bound that lowers a speed by less does not count


class Guarded(Driver):
    """A model whose vehicles brake for others, as human-like drivers do that never look away."""

    def __init__(self, model: BatchBehavior) -> None:
        self.inner = clear_of_others(model)

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on: the guard sees all vehicles."""
        return None if declared(self.inner).sight is None else "everyone"

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the model's plan, slowed down where necessary."""
        plan = self.inner.plan(history, road, vehicles, rng)
        aware = np.ones((len(vehicles), PLAN_STEPS), dtype=np.bool_)
        human = replace(human_parameters(), creep_gap_m=LAST_GAP_M)
        return yielding(plan, history, road, vehicles, human, aware) if len(vehicles) else plan


def yielding(
    plan: Plan,
    history: SceneHistory,
    road: Road,
    vehicles: VehicleIndex,
    human: HumanParameters,
    aware: BoolArray,
) -> Plan:
    """Return plans (n, H) slowed down for conflicts while their drivers are aware of them (n, H)."""
    paths = planned_paths(plan, history, vehicles, human)
    lines = find_stop_lines(paths, history, road, vehicles, human).joined_by(_leaping(paths))
    if not len(lines.row):
        return plan
    rows, speed, arc = _timed(paths, lines, aware, human)
    slow = plan.map(np.copy)
    slow.assign(rows, paths.poses(rows, arc, speed))
    return replace(plan, **vars(slow))


def _leaping(paths: PlannedWays) -> IntArray:
    """Return vehicles whose plan leaps, as a replay does that was slowed down."""
    v = paths.states.speed[:, 0]
    fast = paths.states.speed[:, 1] > v + LEAP_MPS2 * STEP_S
    far = paths.arc[:, 1] > (v + LEAP_MPS2 * STEP_S / 2) * STEP_S + LEAP_M
    return np.flatnonzero(fast | far)


def _timed(
    paths: PlannedWays, lines: StopLines, aware: BoolArray, human: HumanParameters
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return (r,) which vehicles are slowed, and their speeds and arc lengths (r, H)."""
    rows, first = np.unique(lines.row, return_index=True)  # rows are sorted
    s, v = np.zeros(len(rows)), paths.states.speed[rows, 0]
    # Vehicles are the last axis, so that operations run along memory.
    planned, arcs = paths.states.speed[rows, 1:].T.copy(), paths.arc[rows].T.copy()
    moves_m, held = np.diff(arcs, axis=0), np.zeros(len(rows), dtype=np.bool_)
    count = np.diff(np.append(first, len(lines.row)))
    gain = np.diff(planned, axis=0, prepend=v[None]) / STEP_S
    gain = np.maximum(np.where(gain > LEAP_MPS2, 0.0, gain), human.release_mps2)
    timed = np.empty((2, *planned.shape))
    for step, (speed_then, way_then) in enumerate(zip(planned, moves_m, strict=True)):
        s_of_lines, v_of_lines = np.repeat(s, count), np.repeat(v, count)
        bound = responses(lines, first, step, s_of_lines, v_of_lines, aware=aware, human=human)
        wanted = np.minimum(np.minimum(speed_then, bound), v + gain[step] * STEP_S)
        following = np.maximum(np.minimum(wanted, speed_then), 0.0)
        moved = (v + following) * (STEP_S / 2)
        held |= (following < speed_then - MIN_CHANGE_MPS) | (moved < way_then - LEAP_M)
        s = np.where(held, s + np.minimum(moved, way_then), arcs[step + 1])
        v = following
        timed[0, step], timed[1, step] = v, s
    return rows[held], timed[0].T[held], timed[1].T[held]


def responses(
    lines: StopLines,
    first: IntArray,
    step: int,
    s: FloatArray,
    v: FloatArray,
    *,
    aware: BoolArray,
    human: HumanParameters,
) -> FloatArray:
    """Return the highest speed after a step of each vehicle with a stop line, m/s.

    A driver brakes as hard as needed once that is noticeable: from ``onset_mps2`` on, later if both miss each
    other with constant velocity, or if it looks away.
    """
    t = step * STEP_S
    needed = needed_braking(lines, t, s + human.stop_gap_m, v, human.entry_gap_m)
    # It is enough to arrive after one that crosses has left.
    k = np.flatnonzero((lines.speed == 0) & np.isfinite(lines.until))
    left, distance_m = np.maximum(lines.until[k] - t, STEP_S), lines.position[k] - s[k] - human.stop_gap_m
    needed[k] = np.minimum(needed[k], arriving_later(distance_m, left, v[k]))
    onset = np.where(lines.safe, human.safe_onset, 1.0) * human.onset_mps2
    onset = np.where(aware[lines.row, step], onset, np.maximum(onset, human.looming_mps2))
    most = np.where(lines.firm, human.conflict_braking_mps2, human.yielding_mps2)
    # One that enters further behind looks out itself.
    behind = (lines.enter > t) & (lines.position + lines.speed * lines.enter < s - human.fall_back_m)
    acts = (needed > onset) & (lines.until > t) & ~behind
    allowed = np.where(acts, v - np.minimum(needed, most) * STEP_S, np.inf)
    # Nearer than the stop gap a driver creeps, also behind one that closes in or crosses soon.
    position, leader = line_motion(lines, t)
    gap, soon = position - s, np.where(lines.speed == 0, human.crossing_s, 0.0)
    close = (gap >= 0) & (lines.enter <= t + soon)
    close |= ~lines.safe & (gap > -human.fall_back_m) & (lines.enter <= t)
    close &= (gap < human.stop_gap_m) & (lines.until > t)
    creeps = leader + (gap - human.creep_gap_m) / human.creep_s
    creeps = np.maximum(creeps, v - human.conflict_braking_mps2 * STEP_S)
    allowed = np.where(close, np.minimum(allowed, creeps), allowed)
    return np.asarray(np.minimum.reduceat(allowed, first))


def needed_braking(
    lines: StopLines, t: float, s: FloatArray, v: FloatArray, entry_gap_m: float
) -> FloatArray:
    """Return (P,) constant decelerations with which vehicles just stay behind their stop lines, m/s².

    ``t``: s since the plan began; ``s``: (P,) places of vehicles along their plans, m; ``v``: (P,) m/s;
    ``entry_gap_m``: to a vehicle that enters later.
    """
    position, leader = line_motion(lines, t)
    room = 2 * np.maximum(position - s - LAST_GAP_M, LAST_GAP_M)
    needed: FloatArray = np.maximum(v - leader, 0.0) ** 2 / room
    brakes = np.flatnonzero((lines.deceleration > 0) & (leader > 0))
    to_stop = leader[brakes] ** 2 / lines.deceleration[brakes]
    needed[brakes] = np.maximum(needed[brakes], v[brakes] ** 2 / (room[brakes] + to_stop))
    early = np.flatnonzero((lines.enter > t) & (lines.speed > 0))
    ahead = lines.position[early] + lines.speed[early] * lines.enter[early] - s[early] - entry_gap_m
    # It is enough to stop before the place, or to arrive no sooner than the other one.
    stop = v[early] ** 2 / (2 * np.maximum(ahead, LAST_GAP_M))
    left = np.maximum(lines.enter[early] - t, STEP_S)
    needed[early] = np.minimum(stop, arriving_later(ahead, left, v[early]))
    return needed


def arriving_later(distance_m: FloatArray, time_s: FloatArray, v: FloatArray) -> FloatArray:
    """Return (P,) constant decelerations with which vehicles come a way, m, in no less than a time, m/s².

    On a short way they stop at its end before; beyond the place it no longer matters.
    """
    late = 2 * np.maximum(v - np.maximum(distance_m, 0.0) / time_s, 0.0) / time_s
    stops = (distance_m > 0) & (2 * distance_m < v * time_s)
    return np.where(stops, v**2 / (2 * np.maximum(distance_m, LAST_GAP_M)), late)


def line_motion(lines: StopLines, t: float) -> tuple[FloatArray, FloatArray]:
    """Return positions (P,) m and speeds (P,) m/s of stop lines at a time."""
    gone = np.minimum(t, lines.stop_time)
    position: FloatArray = lines.position + lines.speed * gone - 0.5 * lines.deceleration * gone**2
    return position, np.maximum(lines.speed - lines.deceleration * gone, 0.0)
