"""Decoding of network outputs into plans: along a path, or free trajectories."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import JOIN_ANGLE_RAD, REAR_AXLE_SHARE, Intent, map_plan
from scex_sumo.behaviors.driving.paths import OnPath, SeedPaths, path_positions
from scex_sumo.humans.guard.side_clearance import offsets_beside, reached
from scex_sumo.learned.inputs.surface import path_room
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

EDGE_MARGIN_M = 0.15  # of the box to the edge of the drivable surface
SMOOTHING_STEPS = 4  # to both sides
STANDING_M = 0.01  # per step; below, a free trajectory keeps its heading


def intent_along(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    path: IntArray,
    acceleration: FloatArray,
    offset: FloatArray,
    road: Road,
    *,
    clear: bool = False,
) -> Intent:
    """Return the drive along paths with given accelerations and offsets, with every box on the road.

    Args:
        acceleration: (n, H) m/s²; vehicles stop instead of reversing.
        offset: (n, H) wanted distance left of the path after each step, m.
        clear: also keeps boxes away from those beside them.
    """
    now = history.now[vehicles.future, vehicles.vehicle]
    s, present, _ = path_positions(history, vehicles, paths, path)
    travelled_m, wanted = way_of(now.speed, acceleration), np.concatenate([present[:, None], offset], axis=1)
    left, right = path_room(paths, road).at(path[:, None], s[:, None] + travelled_m)
    half = (history.scene.width[vehicles.vehicle] / 2 + EDGE_MARGIN_M)[:, None]
    least, most = _consistent(half - reached(right), reached(left) - half)
    if clear:
        right, left = offsets_beside(OnPath(history, vehicles, paths, path), s, travelled_m)
        least, most = _consistent(np.maximum(least, right), np.minimum(most, left))
    # Bounding again would let offsets jump by centimetres, and steering follows their second derivative.
    wanted = _smoothed(np.clip(wanted, least, most))
    # the rear axle follows the path
    behind = (REAR_AXLE_SHARE * history.scene.length[vehicles.vehicle])[:, None]
    wanted = wanted - behind * _slope(wanted, travelled_m)
    return Intent(vehicles, paths, path, lambda step, *_: acceleration[:, step], aside=wanted)


def _smoothed(offset: FloatArray) -> FloatArray:
    reach, window = np.arange(1, SMOOTHING_STEPS + 1), 2 * SMOOTHING_STEPS + 1
    for _ in range(2):
        before = offset[:, :1] - (offset[:, 1:2] - offset[:, :1]) * reach[::-1]
        after = offset[:, -1:] + (offset[:, -1:] - offset[:, -2:-1]) * reach
        padded = np.concatenate([before, offset, after], axis=1)
        offset = np.lib.stride_tricks.sliding_window_view(padded, window, axis=1).mean(axis=2)
    return offset


def way_of(speed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return (n, H + 1) ways from now on, m, of vehicles that stop instead of reversing."""
    v = np.maximum(speed, 0.0)
    travelled_m = np.zeros((len(speed), acceleration.shape[1] + 1))
    for step in range(acceleration.shape[1]):
        following = np.maximum(v + acceleration[:, step] * STEP_S, 0.0)
        travelled_m[:, step + 1] = travelled_m[:, step] + (v + following) * (STEP_S / 2)
        v = following
    return travelled_m


def _slope(offset: FloatArray, travelled_m: FloatArray) -> FloatArray:
    change, moved = np.diff(offset, axis=1), np.diff(travelled_m, axis=1)
    slope = np.where(moved > STANDING_M, change / np.maximum(moved, STANDING_M), 0.0)
    slopes: FloatArray = np.concatenate([slope, slope[:, -1:]], axis=1)
    return np.clip(slopes, -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD, out=slopes)


def _consistent(least: FloatArray, most: FloatArray) -> tuple[FloatArray, FloatArray]:
    middle, narrow = (most + least) / 2, most < least
    return np.where(narrow, middle, least), np.where(narrow, middle, most)


def plan_freely(history: SceneHistory, vehicles: VehicleIndex, free: FloatArray) -> Plan:
    """Take (n, H, 2) trajectories in the vehicles' frames unchanged, m, with headings along the motion."""
    step = np.diff(free, axis=1, prepend=np.zeros((len(vehicles), 1, 2)))
    moved = np.hypot(step[..., 0], step[..., 1])
    turn = np.concatenate([np.zeros((len(free), 1)), np.arctan2(step[..., 1], step[..., 0])], axis=1)
    last = np.maximum.accumulate(np.where(moved > STANDING_M, np.arange(1, turn.shape[1]), 0), axis=1)
    kept = np.take_along_axis(turn, last, axis=1)
    own = States(x=free[..., 0], y=free[..., 1], heading=kept, speed=moved / STEP_S)
    return map_plan(history.now[vehicles.future, vehicles.vehicle], own)
