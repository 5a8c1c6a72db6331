"""Path inputs of learned drivers in SI units: own motion, road ahead, vehicles on it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import Ahead, find_ahead
from scex_sumo.behaviors.driving.paths import SeedPaths, expected_way
from scex_sumo.geometry.polylines import wrap
from scex_sumo.learned.inputs.surface import path_room
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, States, VehicleIndex

FURTHEST_M = 100.0
AHEAD_M = (5.0, 10.0, 20.0, 40.0, 60.0)
MAX_AHEAD = 10
RATE_STEPS = 3  # for accelerations and yaw rates
PAST_S = np.arange(-HISTORY_STEPS, 1) * STEP_S
TREND = (PAST_S - PAST_S.mean()) / ((PAST_S - PAST_S.mean()) ** 2).sum()  # weights of a straight line's slope


def _end_of_fit(degree: int, states: int) -> FloatArray:
    fit = np.linalg.pinv(np.vander(PAST_S[-states:], degree + 1, increasing=True))[0]
    return np.asarray(np.concatenate([np.zeros(HISTORY_STEPS + 1 - states), fit]))


# Estimates of the present speed, as weights of the past second's speeds.
STEADIER = {
    "mean_of_3": _end_of_fit(0, 3),
    "mean_of_6": _end_of_fit(0, 6),
    "mean_of_11": _end_of_fit(0, 11),
    "line_of_6": _end_of_fit(1, 6),
    "line_of_11": _end_of_fit(1, 11),
    "parabola_of_11": _end_of_fit(2, 11),
}
STANDING_MPS = 0.5
QUEUEING_MPS = 0.7  # a tracker sees standing vehicles creep
ALONG_COS = 0.7  # of the heading difference of vehicles in the same direction

OWN_COLUMNS = (
    *("speed", "mean_speed", "acceleration", "trend", "yaw_rate", "offset", "heading_error"),
    *("yaw_rate_error", "room_left", "room_right", "end", *STEADIER, "unsteady", "stood"),
)
ROAD_COLUMNS = tuple(
    f"{name}_{ahead:g}" for name in ("x", "y", "heading", "curvature", "limit") for ahead in AHEAD_M
)
LEADER_COLUMNS = (
    *("leader", "leader_gap", "leader_speed", "leader_trend", "closing", "needed_deceleration"),
    *("ahead", "ahead_standing", "ahead_speed", "first_standing_gap", "last_standing_gap"),
)
PATH_COLUMNS = OWN_COLUMNS + ROAD_COLUMNS + LEADER_COLUMNS  # other vehicles come last


class PathInputs(NamedTuple):
    """Inputs of a network for n pairs of a vehicle and a path."""

    node: IntArray  # (n,) future * V + vehicle
    features: FloatArray  # (n, P) the `PATH_COLUMNS`
    leader: IntArray  # (n,) node of the leader; -1 without one, and behind an obstacle


def path_inputs(
    history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
) -> PathInputs:
    """Return the inputs of n pairs of a vehicle and a path, in the vehicle's frame; SI units.

    - `OWN_COLUMNS`: errors against the path, offset left positive; `end` is the way to the end of the mapped
      road; `STEADIER` speeds are minus the present one.
    - `LEADER_COLUMNS`: without a leader a gap of 100 m and the vehicle's speed. From `ahead` on they are of
      the vehicles ahead in the same direction.

    Args:
        path: (n,) path of each; a vehicle may occur with several paths.
    """
    now = history.now[vehicles.future, vehicles.vehicle]
    s, offset, path_heading = paths.foot_points(path, now.x, now.y, expected_way(history, vehicles))
    room = path_room(paths, road)
    left, right = room.at(path, s)
    half = history.scene.width[vehicles.vehicle] / 2
    sides = np.maximum(np.column_stack([left, right]) - half[:, None], 0.0)
    past = history.states[vehicles.future, vehicles.vehicle]
    before, duration = past[:, -1 - RATE_STEPS], RATE_STEPS * STEP_S
    yaw_rate = wrap(now.heading - before.heading) / duration
    path_curvature = paths.at(path, s)[5]
    error = wrap(now.heading - path_heading)
    trend = past.speed @ TREND
    line = past.speed.mean(axis=1, keepdims=True) + trend[:, None] * (PAST_S - PAST_S.mean())
    motion = np.column_stack(
        [
            now.speed,
            past.speed.mean(axis=1),
            (now.speed - before.speed) / duration,
            trend,
            yaw_rate,
            offset,
            error,
            yaw_rate - now.speed * path_curvature,
            np.minimum(sides, 10.0),
            np.clip(room.end[path] - s, 0.0, FURTHEST_M),
            past.speed @ np.column_stack([*STEADIER.values()]) - now.speed[:, None],
            np.abs(past.speed - line).mean(axis=1),
            (past.speed < STANDING_MPS).mean(axis=1),
        ]
    )
    road_ahead = _road_ahead(paths, path, s, now, path_heading + error)
    others, leader = _others(history, vehicles, find_ahead(history, vehicles, paths, path, s), now.speed)
    features = np.concatenate([motion, road_ahead, others], axis=1)
    first = vehicles.future * history.scene.vehicles  # node of the future's first vehicle
    is_vehicle = (leader >= 0) & (leader < history.scene.vehicles)
    return PathInputs(first + vehicles.vehicle, features, np.where(is_vehicle, first + leader, -1))


def _road_ahead(
    paths: SeedPaths, path: IntArray, s: FloatArray, now: States, reference: FloatArray
) -> FloatArray:
    n, k = len(path), len(AHEAD_M)
    repeated = np.repeat(path, k)
    arc_length = (s[:, None] + np.array(AHEAD_M)).ravel()
    px, py, _, _, heading, curvature = paths.at(repeated, arc_length).reshape(6, n, k)
    limit = paths.speed_limit.ravel()[paths.sample_at(repeated, arc_length)].reshape(n, k)
    places = now.ahead_and_left(px, py)
    return np.concatenate([*places, heading - reference[:, None], curvature, limit], axis=1)


def _others(
    history: SceneHistory, vehicles: VehicleIndex, ahead: Ahead, speed: FloatArray
) -> tuple[FloatArray, IntArray]:
    nearest = ahead.leaders(len(vehicles))
    has_leader = nearest.index >= 0
    gap = np.clip(np.where(has_leader, nearest.gap, FURTHEST_M), -5.0, FURTHEST_M)
    leader_speed = np.where(has_leader, nearest.speed, speed)
    closing = speed - leader_speed
    needed = np.maximum(closing, 0.0) ** 2 / (2 * np.maximum(gap, 1.0))
    vehicle = has_leader & (nearest.index < history.scene.vehicles)
    past = history.states.speed[vehicles.future, np.where(vehicle, nearest.index, 0)]
    trend = np.where(vehicle, past @ TREND, 0.0)
    leader = [has_leader, gap, leader_speed, trend, closing, np.minimum(needed, 20.0)]
    same_way = (ahead.cos > ALONG_COS) & (ahead.other < history.scene.vehicles)
    return np.column_stack([*leader, _queue(ahead, same_way, speed)]), nearest.index


def _queue(ahead: Ahead, same_way: BoolArray, speed: FloatArray) -> FloatArray:
    n, driver, gap = len(speed), ahead.driver[same_way], np.clip(ahead.gap[same_way], -5.0, FURTHEST_M)
    stands = ahead.speed[same_way] < QUEUEING_MPS
    count, queue = np.bincount(driver, minlength=n), driver[stands]
    total = np.bincount(driver, ahead.speed[same_way], minlength=n)
    first, last = np.full(n, FURTHEST_M), np.zeros(n)
    np.minimum.at(first, queue, gap[stands])
    np.maximum.at(last, queue, gap[stands])
    standing = np.minimum(np.bincount(queue, minlength=n), MAX_AHEAD)
    mean = np.where(count > 0, total / np.maximum(count, 1), speed)
    return np.column_stack([np.minimum(count, MAX_AHEAD), standing, mean, first, last])
