"""Inputs of learned drivers besides the scene graph: the road ahead along a path, and who is on it.

All features are raw SI units; scaling is the network's business. They are made by the same functions when
training and when running.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points, sample_paths
from scex_sumo.behaviors.learned.seen.surface import path_room
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, States, Who

AHEAD_M = (2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 90.0)
CLEARANCE_M = 1.5  # whose centre is this near to the path is on it
RADIUS_M = 100.0
RATE_STEPS = 3  # accelerations and yaw rates are means over so many steps
PAST_S = np.arange(-HISTORY_STEPS, 1) * STEP_S
TREND = (PAST_S - PAST_S.mean()) / ((PAST_S - PAST_S.mean()) ** 2).sum()  # weights of a straight line's slope

OWN_COLUMNS = (
    "speed",
    "mean_speed",
    "acceleration",
    "trend",
    "yaw_rate",
    "offset",
    "heading_error",
    "yaw_rate_error",
    "room_left",
    "room_right",
    "end",
)
ROAD_COLUMNS = tuple(
    f"{name}_{ahead:g}" for name in ("x", "y", "heading", "curvature", "limit") for ahead in AHEAD_M
)
LEADER_COLUMNS = (
    "leader",
    "leader_gap",
    "leader_speed",
    "leader_trend",
    "closing",
    "needed_deceleration",
)
PATH_COLUMNS = OWN_COLUMNS + ROAD_COLUMNS + LEADER_COLUMNS  # what others do comes last


@dataclass(frozen=True, kw_only=True, eq=False)
class PathInputs:
    """What a network sees of n pairs of a vehicle and a path.

    Attributes:
        node: (n,) child * V + vehicle.
        features: (n, P) the `PATH_COLUMNS`.
    """

    node: IntArray
    features: FloatArray


def path_inputs(
    history: SceneHistory, road: Road, who: Who, paths: SeedPaths, row: IntArray, *, radius: float = RADIUS_M
) -> PathInputs:
    """The road ahead of n vehicles along n paths, in each vehicle's own frame.

    Per distance of `AHEAD_M` from the foot point: x ahead and y to the left (m), heading relative to the
    vehicle's (rad, without jumps), curvature (1/m) and speed limit (m/s). Then the vehicle's own motion, with
    the mean and the slope of its speed over the past second (one state may be far off),
    its offset (m, left positive) and heading error against the path, its yaw rate minus what the path asks
    for, the room on both sides, the way to the end of the mapped road (at most 100 m); and the leader on the
    path: whether there is one, gap (100 m without one), speed (the own without one) and its slope, closing
    speed, and the deceleration that brings it to zero within the gap.

    Args:
        who: the n vehicles; the same vehicle may be there with several paths.
        row: (n,) path of each.
        radius: perception radius for leaders, m.
    """
    own = history.now[who.child, who.vehicle]
    s, offset, path_heading = foot_points(paths, row, own.x, own.y, expected_way(history, who))
    room = path_room(paths, road)
    left, right = room.at(row, s)
    half = history.scene.width[who.vehicle] / 2
    sides = np.maximum(np.column_stack([left, right]) - half[:, None], 0.0)
    acceleration, yaw_rate = rates(history, who)
    past = history.states[who.child, who.vehicle]
    here = sample_paths(paths, row, s)
    error = wrap(own.heading - path_heading)
    motion = np.column_stack(
        [
            own.speed,
            past.speed.mean(axis=1),
            acceleration,
            past.speed @ TREND,
            yaw_rate,
            offset,
            error,
            yaw_rate - own.speed * here[5],
            np.minimum(sides, 10.0),
            np.clip(room.end[row] - s, 0.0, 100.0),
        ]
    )
    features = np.concatenate(
        [
            motion,
            _road_ahead(paths, row, s, own, path_heading + error),
            _leader(history, who, paths, row, s, own.speed, radius),
        ],
        axis=1,
    )
    node = who.child * history.scene.vehicles + who.vehicle
    return PathInputs(node=node, features=features)


def rates(history: SceneHistory, who: Who) -> tuple[FloatArray, FloatArray]:
    """(n,) acceleration, m/s², and (n,) yaw rate, rad/s: means over the last 0.3 s."""
    now = history.states[who.child, who.vehicle, -1]
    before = history.states[who.child, who.vehicle, -1 - RATE_STEPS]
    duration = RATE_STEPS * STEP_S
    return (now.speed - before.speed) / duration, wrap(now.heading - before.heading) / duration


def _road_ahead(
    paths: SeedPaths, row: IntArray, s: FloatArray, own: States, reference: FloatArray
) -> FloatArray:
    """(n, 5 * K) points of the path ahead; `reference` is the own heading plus a multiple of 2 pi."""
    n, k = len(row), len(AHEAD_M)
    rows = np.repeat(row, k)
    at = (s[:, None] + np.array(AHEAD_M)).ravel()
    px, py, _, _, heading, curvature = sample_paths(paths, rows, at).reshape(6, n, k)
    index = np.clip(at * (1 / DS_M), 0, paths.samples - 1).astype(np.int64)
    limit = paths.speed_limit.ravel()[rows * paths.samples + index].reshape(n, k)
    cos, sin = np.cos(own.heading)[:, None], np.sin(own.heading)[:, None]
    dx, dy = px - own.x[:, None], py - own.y[:, None]
    return np.concatenate(
        [cos * dx + sin * dy, cos * dy - sin * dx, heading - reference[:, None], curvature, limit], axis=1
    )


def _leader(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    speed: FloatArray,
    radius: float,
) -> FloatArray:
    """(n, 6) the `LEADER_COLUMNS`."""
    found = find_leaders(history, who, paths, row, s, clearance=CLEARANCE_M, radius=radius)
    there = found.index >= 0
    gap = np.clip(np.where(there, found.gap, 100.0), -5.0, 100.0)
    leader_speed = np.where(there, found.speed, speed)
    closing = speed - leader_speed
    needed = np.maximum(closing, 0.0) ** 2 / (2 * np.maximum(gap, 1.0))
    vehicle = there & (found.index < history.scene.vehicles)
    past = history.states.speed[who.child, np.where(vehicle, found.index, 0)]
    trend = np.where(vehicle, past @ TREND, 0.0)
    return np.column_stack([there, gap, leader_speed, trend, closing, np.minimum(needed, 20.0)])
