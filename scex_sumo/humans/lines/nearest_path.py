"""Fallback plan of a vehicle: ``calibrated_driver`` on the nearest path, or straight on."""

from __future__ import annotations

import numpy as np

from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import chosen_paths, expected_way, nearest_paths
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmDriver
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

OFF_PATH_M = 5.0  # a vehicle further from all its paths goes straight on
AGAINST_PATH_RAD = np.pi / 2  # as does one with a larger heading error


def follow_path(history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Plan:
    """Plan 3 s for vehicles without a plan: ``calibrated_driver`` on the nearest path, or straight on."""
    paths, straight = chosen_paths(history, road, vehicles, "straight")
    now, arc_length = history.now[vehicles.future, vehicles.vehicle], expected_way(history, vehicles)
    row, (_, offset, heading) = nearest_paths(
        paths, straight, vehicles.vehicle, arc_length, now.x, now.y, now.heading
    )
    off = (np.abs(offset) > OFF_PATH_M) | (np.abs(wrap(now.heading - heading)) > AGAINST_PATH_RAD)
    plan = driven(history, [IdmDriver(CALIBRATED).follow(history, vehicles, paths, row)])[0]
    plan.assign(off, _straight_on(history, vehicles[off]))
    return plan


def _straight_on(history: SceneHistory, vehicles: VehicleIndex) -> Plan:
    now = history.now[vehicles.future, vehicles.vehicle]
    speed = np.maximum(now.speed, 0.0)[:, None] * np.ones(PLAN_STEPS)
    return Plan(**vars(now.ahead(speed * STEP_S * np.arange(1, PLAN_STEPS + 1), speed)))
