"""Attention: glances away from the road, reaction times, late responses, and room to boxes beside.

A driver acts on what it saw one reaction time ago. If it looked away then, it follows no leader and brakes
late for a conflict.

A few have let hard braking become necessary, because they have not seen what comes. The largest need of an
encounter is exponentially distributed among drivers that look, and with a far larger scale among the few that
do not. One that needs much at the seed moment and does not brake probably is one of these. It responds after
a lognormal time, as to a surprise, and drives on as it does until then.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.draws import normal_quantiles, uniforms
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, SLOPE_SPEED, Accelerate, rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.conflicts.braking import (
    HORIZON_S,
    DrivenPaths,
    needed_braking,
    recent_acceleration,
    shared_stretches,
)
from scex_sumo.humans.guard.side_clearance import offsets_beside
from scex_sumo.humans.observed.observations import View
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene, VehicleIndex

GLANCE = 100_000  # salt of draws, beyond those of all steps; glances may begin before 0 s
# Scale of the largest need by the follower's speed: m/s, and m/s² (benchmarks/fit_conflicts.py)
SCALES: Final = ((1.5, 4.5, 7.5, 11.0), (0.25, 0.33, 0.5, 0.6))
UNSEEN_MPS2: Final = 3.0  # the same among drivers that do not look, about
UNSEEN: Final = 2.7e-4  # their share: contacts are then as frequent as published (docs/decision.md)
BRAKES_MPS2: Final = -1.0  # mean acceleration over half a second below which a driver brakes
MOST_NEED_MPS2: Final = 8.0  # from it not the driver is taken to be wrong, but its expected way
RESPONSE_S: Final = 1.25  # median time until one brakes for what one did not expect (Green 2000)
SPREAD: Final = 0.35  # deviation of its logarithm, chosen within the ranges of Green 2000
_SALT = 80_000  # of the draws
_POINTS = 32  # of a path ahead
_BEFORE = 4  # steps for which it has been necessary


def awareness(view: View, leaders: Leaders, factor: float) -> BoolArray:
    """Return (n, H) whether drivers act on the others in a step, by what they saw one reaction time ago.

    It follows from `SceneHistory.route_draw` and the time alone. A driver that was closing in on its leader a
    second ago does not look away. ``factor``: on the share of time of glances.
    """
    history, human = view.history, view.human
    draw = history.route_draw[view.vehicles.future, view.vehicles.vehicle]
    seen = STEP_S * np.arange(history.step, history.step + PLAN_STEPS) - human.reaction_s
    watching = _braking_asked(view, leaders) > human.watching_mps2
    away = looks_away(draw, np.broadcast_to(seen, (len(draw), PLAN_STEPS)), human, factor)
    return ~away | watching[:, None]


def _braking_asked(view: View, leaders: Leaders) -> FloatArray:
    """Return (n,) braking that the leader asked for a second ago, m/s²."""
    history, vehicles = view.history, view.vehicles
    speed = history.states.speed[vehicles.future, vehicles.vehicle]
    vehicle = np.flatnonzero((leaders.index >= 0) & (leaders.index < history.scene.vehicles))
    before = np.repeat(leaders.speed[:, None], speed.shape[1], axis=1)
    before[vehicle] = history.states.speed[vehicles.future[vehicle], leaders.index[vehicle]]
    gap = leaders.gap + STEP_S * (speed[:, 1:] - before[:, 1:]).sum(axis=1)
    closing = np.maximum(speed[:, 0] - before[:, 0], 0.0)
    return np.asarray(closing**2 / (2 * np.maximum(gap, view.human.watching_gap_m)))


def looks_away(
    draw: FloatArray, time_s: FloatArray, human: HumanParameters, factor: float = 1.0
) -> BoolArray:
    """Return (n, T) whether drivers, by draws (n,), look away at times (n, T) since the seed moment.

    One glance begins at a random time in each ``glance_every_s``, also before the seed moment. ``factor``: on
    the rate of glances, up to 1, or on their durations beyond it.
    """
    away = np.zeros(time_s.shape, dtype=np.bool_)
    if not factor or not time_s.size:
        return away
    every = human.glance_every_s
    first, last = (int(np.floor(edge / every)) for edge in (time_s.min(), time_s.max()))
    for number in range(first - 1, last + 1):
        begin, length, there = uniforms(draw, 3, GLANCE + number).T
        start = every * (number + begin)
        lasts = human.glance_s * max(factor, 1.0) * np.exp(human.glance_spread * normal_quantiles(length))
        lasts = np.where(there < factor, lasts, 0.0)
        away |= (time_s >= start[:, None]) & (time_s < (start + lasts)[:, None])
    return away


def still_unaware(
    history: SceneHistory, paths: SeedPaths, vehicles: VehicleIndex, spread: float
) -> BoolArray:
    """Return (n,) whether drivers have not responded yet; ``spread``: on the variation between them."""
    need = needs(history.scene, paths)[vehicles.vehicle]
    draws = uniforms(history.route_draw[vehicles.future, vehicles.vehicle], 2, _SALT)
    response_s = RESPONSE_S * np.exp(SPREAD * min(spread, 1.0) * normal_quantiles(draws[:, 0]))
    looks = draws[:, 1] >= share_unseen(need, history.scene.now.speed[vehicles.vehicle])
    return np.asarray(~looks & (history.step * STEP_S < response_s))


def share_unseen(need: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the share (n,) of drivers that have not seen what they need to brake for.

    ``need``: (n,) of braking, m/s²; from `MOST_NEED_MPS2` on the share is 0; ``speed``: (n,) m/s.
    """
    looking = (1 - UNSEEN) * np.exp(-need / np.interp(speed, *SCALES))
    unseen = UNSEEN * np.exp(-need / UNSEEN_MPS2)
    return np.where((need > 0) & (need < MOST_NEED_MPS2), unseen / (looking + unseen), 0.0)


def unchanged(accelerate: Accelerate, rows: BoolArray) -> Accelerate:
    """Return the same acceleration, but none of some vehicles (n,)."""
    return lambda *now: np.where(rows, 0.0, accelerate(*now))


@owner_cache
def needs(scene: SeedScene, paths: SeedPaths) -> FloatArray:
    """Return (V,) braking that vehicles have needed for 0.4 s, m/s²; 0 for those that brake already."""
    past, now = scene.history, scene.now
    path = paths.first + paths.straight
    s, _, _ = paths.foot_points(path, now.x, now.y, np.full(scene.vehicles, BEHIND_M))
    reach = np.maximum(HORIZON_S * now.speed, 1.0)[:, None]
    sample = (s[:, None] + reach * np.linspace(0.05, 1.0, _POINTS)) / DS_M
    index = path[:, None] * paths.samples + np.clip(np.rint(sample), 0, paths.samples - 1).astype(np.int64)
    driven = DrivenPaths.of(past, scene.length, scene.width, paths.table[index, :2].transpose(2, 0, 1))
    one, two = np.triu_indices(scene.vehicles, 1)
    acceleration = recent_acceleration(past.speed)
    steps, need = np.array([HISTORY_STEPS - _BEFORE, HISTORY_STEPS]), np.zeros(scene.vehicles)
    for side in shared_stretches(driven, one, two):
        np.maximum.at(need, side.own, needed_braking(driven, side, acceleration, steps).min(axis=1))
    return np.where(acceleration[:, -1] > BRAKES_MPS2, need, 0.0)


def kept_clear(aside: FloatArray, view: View) -> FloatArray:
    """Return wanted offsets (n, H + 1) of rear axles that keep the bodies within the room to boxes beside.

    The front of a long vehicle reaches further to the side than its rear axle, which follows it.
    """
    history, vehicles, paths, row, s, _ = view
    time = STEP_S * np.arange(aside.shape[1])
    travelled_m = np.maximum(history.now[vehicles.future, vehicles.vehicle].speed, 0.0)[:, None] * time
    margin, passing, steepest = view.human.beside_gap_m, view.human.passing_gap_m, view.human.max_slope
    least, most = offsets_beside(view.on_path, s, travelled_m, margin=margin, passing=passing)
    narrow = least > most
    middle = np.where(narrow, least, 0.0) / 2 + np.where(narrow, most, 0.0) / 2
    least, most = np.where(narrow, middle, least), np.where(narrow, middle, most)
    moved = np.maximum(np.diff(travelled_m, axis=1), SLOPE_SPEED * STEP_S)
    slope = np.clip(np.diff(aside, axis=1) / moved, -steepest, steepest)
    length = history.scene.length[vehicles.vehicle]
    reach = (0.5 + REAR_AXLE_SHARE) * length
    front = aside[:, 1:] + reach[:, None] * slope
    held = np.clip(front, least[:, 1:], most[:, 1:])
    k = np.flatnonzero((held != front).any(axis=1))
    x, y = rear_axle(history.now[vehicles.future[k], vehicles.vehicle[k]], length[k])
    kept = aside.copy()
    kept[k, 0] = paths.foot_points(row[k], x, y, (s - REAR_AXLE_SHARE * length)[k])[1]
    follows = 1 - np.exp(-moved[k] / reach[k, None])
    for step in range(held.shape[1]):
        kept[k, step + 1] = kept[k, step] + (held[k, step] - kept[k, step]) * follows[:, step]
    return kept
