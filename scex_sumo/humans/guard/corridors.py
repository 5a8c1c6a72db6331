"""Corridors of the guard: planned ways of its vehicles, expected motion of all others."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.leaders import Everyone, everyone
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, rear_axle
from scex_sumo.behaviors.driving.paths import chosen_paths, expected_way, nearest_paths
from scex_sumo.geometry.crossings import Polylines
from scex_sumo.geometry.polylines import wrap
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

SAMPLE_S = 0.4  # a car that crosses at 15 m/s is in the corridor for longer
SAMPLES = 11  # the present, and 4 s ahead
VERTEX_STEPS = 3  # planned steps between two vertices of the corridor
DRIFT_S = 1.5  # motion across the path dies out with this time constant
BRAKING_STEPS = 5  # driven steps over which a leader's braking is measured, at most


class PlannedWays(NamedTuple):
    """Plans of n vehicles by arc length; the present is arc length 0."""

    states: States  # (n, H + 1), the present first; speeds are at least 0
    arc: FloatArray  # (n, H + 1) m, does not fall
    middle: Polylines  # of the corridors: planned poses, and one at the braking distance

    def poses(self, rows: IntArray, s: FloatArray, speed: FloatArray) -> States:
        """Return states (r, H) at arc lengths (r, H)."""
        arc = self.arc[rows]
        last = arc.shape[1] - 1
        # The last planned pose that is not beyond s.
        index = np.clip((arc[:, None, :] <= s[:, :, None]).sum(axis=2) - 1, 0, last - 1)
        i = np.arange(len(rows))[:, None]
        begin, length = arc[i, index], arc[i, index + 1] - arc[i, index]
        share = np.clip((s - begin) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        before, after = (self.states[rows[:, None], k] for k in (index, index + 1))
        return States(
            x=before.x + share * (after.x - before.x),
            y=before.y + share * (after.y - before.y),
            heading=wrap(before.heading + share * wrap(after.heading - before.heading)),
            speed=speed,
        )


def planned_paths(
    plan: Plan, history: SceneHistory, vehicles: VehicleIndex, human: HumanParameters
) -> PlannedWays:
    """Arrange plans (n, H) by arc length."""
    states = States.concatenate([history.now[vehicles.future, vehicles.vehicle][:, None], plan], axis=1)
    states = replace(states, speed=np.maximum(states.speed, 0.0))
    x, y, arc = states.x, states.y, np.zeros(states.shape)
    np.cumsum(np.sqrt(np.diff(x, axis=1) ** 2 + np.diff(y, axis=1) ** 2), axis=1, out=arc[:, 1:])
    last, end = states.speed[:, -1], states.heading[:, -1]
    ahead = 5.0 + last * human.ahead_s + last**2 / (2 * human.leader_braking_mps2)
    corners = np.append(np.arange(0, x.shape[1] - 1, VERTEX_STEPS), x.shape[1] - 1)
    middle = Polylines(
        x=np.column_stack([x[:, corners], x[:, -1] + ahead * np.cos(end)]),
        y=np.column_stack([y[:, corners], y[:, -1] + ahead * np.sin(end)]),
        arc=np.column_stack([arc[:, corners], arc[:, -1] + ahead]),
    )
    return PlannedWays(states, arc, middle)


@owner_cache
def expected(history: SceneHistory, road: Road) -> tuple[Everyone, States, FloatArray]:
    """Predict vehicles along their paths, and pedestrians and cyclists straight on, at present speeds.

    Return all of M = V + O, vehicles first; (C, M, K) poses at the K = `SAMPLES` moments; (C, M) present
    deceleration, m/s², at least 0.
    """
    others = everyone(history)
    t: FloatArray = SAMPLE_S * np.arange(SAMPLES, dtype=np.float64)
    travelled_m = np.maximum(others.states.speed, 0.0)[..., None] * t
    motion = others.states.ahead(travelled_m, np.zeros_like(travelled_m))
    vehicles, driven = history.scene.vehicles, np.flatnonzero(~others.obstacle)
    along = _along_paths(history, road, t)
    for straight, bent in zip((motion.x, motion.y, motion.heading), along, strict=True):
        straight[:, driven] = bent[:, driven]
    braking, change = np.zeros(others.states.shape), np.diff(history.states.speed) / STEP_S
    # Recorded speeds leap, which does not change the median; driven ones do not.
    steps = min(history.step, BRAKING_STEPS)
    mean = change[..., -steps:].mean(axis=-1) if steps else np.median(change, axis=-1)
    braking[:, :vehicles] = np.maximum(-mean, 0.0)
    return others, motion, braking


def _along_paths(
    history: SceneHistory, road: Road, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y, heading (C, V, K) of vehicles along their paths."""
    shape, vehicles, now = history.now.shape, VehicleIndex.everyone(history), history.now.map(np.ravel)
    paths, straight = chosen_paths(history, road, vehicles, "straight")
    # The rear axle follows the path, as in `drive`.
    length = history.scene.length[vehicles.vehicle]
    axle, expected_m = rear_axle(now, length), expected_way(history, vehicles)
    path, feet = nearest_paths(paths, straight, vehicles.vehicle, expected_m, *axle, now.heading)
    s, offset, path_heading = feet
    error = wrap(now.heading - path_heading)
    v = np.maximum(now.speed, 0.0)
    drift, fade = v * np.sin(error), np.exp(-t / DRIFT_S)
    # The drift dies out; the offset stays.
    side = offset[:, None] + drift[:, None] * (DRIFT_S * (1 - fade))
    arc = s[:, None] + (v * np.cos(error))[:, None] * t
    px, py, cos, sin, direction, _ = paths.at(np.repeat(path, len(t)), arc.ravel()).reshape(6, *arc.shape)
    heading = direction + error[:, None] * fade
    ahead = (REAR_AXLE_SHARE * length)[:, None]
    x, y = px - sin * side + ahead * np.cos(heading), py + cos * side + ahead * np.sin(heading)
    return x.reshape(*shape, -1), y.reshape(*shape, -1), heading.reshape(*shape, -1)
