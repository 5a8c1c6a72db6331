"""Attention: glances away from the road, reaction times, and room to boxes beside.

A driver acts on what it saw one reaction time ago. If it looked away then, it follows no leader and brakes
late for a conflict. It keeps clear of boxes beside it.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.draws import normal_quantiles, uniforms
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, SLOPE_SPEED, rear_axle
from scex_sumo.humans.guard.side_clearance import offsets_beside
from scex_sumo.humans.observed.observations import View
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.scene import STEP_S

GLANCE = 100_000  # salt of draws, beyond those of all steps; glances may begin before 0 s


def awareness(view: View, leaders: Leaders, factor: float) -> BoolArray:
    """Return (n, H) whether drivers act on the others in a step, by what they saw one reaction time ago.

    It follows from `SceneHistory.route_draw` and the time alone. A driver that was closing in on its leader a
    second ago does not look away.

    ``factor``: on the share of time of glances.
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
    """Return (n, T) whether drivers look away from the road.

    One glance begins at a random time in each interval of ``glance_every_s``, also before the seed moment.

    Args:
        draw: (n,) in [0, 1), one per driver.
        time_s: (n, T) since the seed moment.
        factor: on the rate of glances, up to 1, or on their durations beyond it.
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


def kept_clear(aside: FloatArray, view: View) -> FloatArray:
    """Return wanted offsets (n, H + 1) of rear axles that keep the bodies within the room to boxes beside.

    The front of a long vehicle reaches further to the side than its rear axle, which follows it.
    """
    history, vehicles, paths, row, s, _ = view
    time = STEP_S * np.arange(aside.shape[1])
    travelled_m = np.maximum(history.now[vehicles.future, vehicles.vehicle].speed, 0.0)[:, None] * time
    margin, passing, steepest = view.human.beside_gap_m, view.human.passing_gap_m, view.human.max_slope
    beside = history, vehicles, paths, row, s, travelled_m
    least, most = offsets_beside(*beside, margin=margin, passing=passing)
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
