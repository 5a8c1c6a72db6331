"""Path-following driver, for who has no plan: ``calibrated_driver`` along the path that the vehicle is on."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.driving.together import driven
from scex_sumo.behaviors.models.idm import IdmDriver
from scex_sumo.behaviors.models.idm_profile import CALIBRATED
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who

OFF_PATH_M = 5.0  # a vehicle further from all its paths, or across them, drives straight on
AGAINST_PATH_RAD = np.pi / 2
TURN_WEIGHT_M = 5.0  # metres beside a path that count as much as one radian across it
STRAIGHT_BONUS_M = 0.5  # by how much another path must be nearer than the straight one


def follow_path(history: SceneHistory, road: Road, who: Who) -> Plan:
    """The path-following driver: ``calibrated_driver`` along the path that a vehicle is on.

    That is the straight path, or another of the vehicle's where it is clearly nearer to that one. A vehicle
    off all its paths goes straight on at its present speed.

    Returns:
        (n, 30).
    """
    paths, straight = chosen_paths(history, road, who, "straight")
    row, off = _nearest_path(history, who, paths, straight)
    made = driven(history, [IdmDriver(CALIBRATED).follow(history, who, paths, row)])[0]
    made.assign(off, _straight_on(history, who[off]))
    return made


def _nearest_path(
    history: SceneHistory, who: Who, paths: SeedPaths, straight: IntArray
) -> tuple[IntArray, BoolArray]:
    """(n,) row of the path that each vehicle is on, and (n,) True where it is on none."""
    own = history.now[who.child, who.vehicle]
    first, count = paths.first[who.vehicle], paths.count[who.vehicle]
    way = expected_way(history, who)

    def distance(row: IntArray) -> tuple[FloatArray, BoolArray]:
        _, beside, heading = foot_points(paths, row, own.x, own.y, way)
        across = np.abs(wrap(own.heading - heading))
        return np.abs(beside) + TURN_WEIGHT_M * across, (np.abs(beside) > OFF_PATH_M) | (
            across > AGAINST_PATH_RAD
        )

    row = straight.copy()
    best, off = distance(row)
    best = best - STRAIGHT_BONUS_M
    for k in range(int(count.max(initial=0))):
        other = first + np.minimum(k, count - 1)
        cost, away = distance(other)
        nearer = cost < best
        row[nearer], best[nearer], off[nearer] = other[nearer], cost[nearer], away[nearer]
    return row, off


def _straight_on(history: SceneHistory, who: Who) -> Plan:
    own = history.now[who.child, who.vehicle]
    speed = np.maximum(own.speed, 0.0)[:, None] * np.ones(PLAN_STEPS)
    heading = own.heading[:, None] * np.ones(PLAN_STEPS)
    way = speed * STEP_S * np.arange(1, PLAN_STEPS + 1)
    return Plan(
        x=own.x[:, None] + way * np.cos(heading),
        y=own.y[:, None] + way * np.sin(heading),
        heading=heading,
        speed=speed,
    )
