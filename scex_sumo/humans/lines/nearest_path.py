"""Fallback plan of a vehicle: ``calibrated_driver`` on the nearest path, or straight on."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmDriver
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

OFF_PATH_M = 5.0  # a vehicle further from all its paths goes straight on
AGAINST_PATH_RAD = np.pi / 2  # as does one with a larger heading error
TURN_WEIGHT_M = 5.0  # distance that counts as much as a heading error of 1 rad
STRAIGHT_BONUS_M = 0.5  # advantage of the straight path


def follow_path(history: SceneHistory, road: Road, who: VehicleIndex) -> Plan:
    """Plan 3 s for vehicles without a plan: ``calibrated_driver`` on the nearest path, or straight on."""
    paths, straight = chosen_paths(history, road, who, "straight")
    row, off = _nearest_path(history, who, paths, straight)
    plan = driven(history, [IdmDriver(CALIBRATED).follow(history, who, paths, row)])[0]
    plan.assign(off, _straight_on(history, who[off]))
    return plan


def _nearest_path(
    history: SceneHistory, who: VehicleIndex, paths: SeedPaths, straight: IntArray
) -> tuple[IntArray, BoolArray]:
    """Return (n,) path that each vehicle is on, and (n,) True if it is on none."""
    now = history.now[who.future, who.vehicle]
    first, count = paths.first[who.vehicle], paths.count[who.vehicle]
    way = expected_way(history, who)

    def distance(row: IntArray) -> tuple[FloatArray, BoolArray]:
        _, offset, heading = foot_points(paths, row, now.x, now.y, way)
        error = np.abs(wrap(now.heading - heading))
        away = (np.abs(offset) > OFF_PATH_M) | (error > AGAINST_PATH_RAD)
        return np.abs(offset) + TURN_WEIGHT_M * error, away

    row = straight.copy()
    best, off = distance(row)
    best = best - STRAIGHT_BONUS_M
    for k in range(int(count.max(initial=0))):
        other = first + np.minimum(k, count - 1)
        cost, away = distance(other)
        nearer = cost < best
        row[nearer], best[nearer], off[nearer] = other[nearer], cost[nearer], away[nearer]
    return row, off


def _straight_on(history: SceneHistory, who: VehicleIndex) -> Plan:
    now = history.now[who.future, who.vehicle]
    speed = np.maximum(now.speed, 0.0)[:, None] * np.ones(PLAN_STEPS)
    heading = now.heading[:, None] * np.ones(PLAN_STEPS)
    way = speed * STEP_S * np.arange(1, PLAN_STEPS + 1)
    return Plan(
        x=now.x[:, None] + way * np.cos(heading),
        y=now.y[:, None] + way * np.sin(heading),
        heading=heading,
        speed=speed,
    )
