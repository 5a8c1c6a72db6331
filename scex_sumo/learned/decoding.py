"""Decoding of network outputs into plans: along a path, or free trajectories."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import JOIN_ANGLE_RAD, REAR_AXLE_SHARE, Intent, driven, map_plan
from scex_sumo.behaviors.driving.paths import SeedPaths, path_positions
from scex_sumo.humans.guard.side_clearance import offsets_beside, reached
from scex_sumo.learned.inputs.surface import path_room
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

RETURN_S = 3.0  # time constant of returning to the path if no offset is wanted
EDGE_MARGIN_M = 0.15  # of the box to the edge of the drivable surface
SMOOTHING_STEPS = 4  # to both sides
STANDING_M = 0.01  # per step; below, a free trajectory keeps its heading


def plan_along(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    acceleration: FloatArray,
    offset: FloatArray | None,
    *,
    road: Road | None = None,
    clear: bool = False,
) -> Plan:
    """Drive along paths with given accelerations and offsets; arguments as of `intent_along`."""
    intent = intent_along(history, vehicles, paths, row, acceleration, offset, road=road, clear=clear)
    return driven(history, [intent], acceleration.shape[1])[0]


def intent_along(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    acceleration: FloatArray,
    offset: FloatArray | None,
    *,
    road: Road | None = None,
    clear: bool = False,
) -> Intent:
    """Return the drive along paths with given accelerations and offsets.

    Args:
        acceleration: (n, H) m/s²; vehicles stop instead of reversing.
        offset: (n, H) wanted distance left of the path after each step, m; None returns to the path like
            exp(-t / RETURN_S).
        road: keeps every box on the drivable surface of this map; None does not.
        clear: also keeps it away from boxes beside it.
    """
    now = history.now[vehicles.future, vehicles.vehicle]
    s, present, _ = path_positions(history, vehicles, paths, row)
    steps, travelled_m = acceleration.shape[1], way_of(now.speed, acceleration)
    if offset is None:
        wanted = present[:, None] * np.exp(-STEP_S / RETURN_S * np.arange(steps + 1))
    else:
        wanted = np.concatenate([present[:, None], offset], axis=1)
    if road is None:
        wanted = _smoothed(wanted)
    else:
        least, most = _bounds(history, vehicles, paths, row, s, travelled_m, road, clear=clear)
        # Bounding again would let offsets jump by centimetres, and steering follows their second derivative.
        wanted = _smoothed(np.clip(wanted, least, most))
    # the rear axle follows the path
    wanted = wanted - (REAR_AXLE_SHARE * history.scene.length[vehicles.vehicle])[:, None] * _slope(
        wanted, travelled_m
    )

    def accelerate(step: int, *_: FloatArray) -> FloatArray:
        return acceleration[:, step]

    return Intent(vehicles=vehicles, paths=paths, row=row, accelerate=accelerate, aside=wanted)


def _bounds(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    travelled_m: FloatArray,
    road: Road,
    *,
    clear: bool,
) -> tuple[FloatArray, FloatArray]:
    half = history.scene.width[vehicles.vehicle] / 2 + EDGE_MARGIN_M
    least, most = bounds_along(road, paths, row, s, travelled_m, half)
    if not clear:
        return least, most
    right, left = offsets_beside(history, vehicles, paths, row, s, travelled_m)
    return _consistent(np.maximum(least, right), np.minimum(most, left))


def _smoothed(offset: FloatArray) -> FloatArray:
    for _ in range(2):
        reach = np.arange(1, SMOOTHING_STEPS + 1)
        before = offset[:, :1] - (offset[:, 1:2] - offset[:, :1]) * reach[::-1]
        after = offset[:, -1:] + (offset[:, -1:] - offset[:, -2:-1]) * reach
        padded = np.concatenate([before, offset, after], axis=1)
        offset = np.lib.stride_tricks.sliding_window_view(padded, 2 * SMOOTHING_STEPS + 1, axis=1).mean(
            axis=2
        )
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
    whole: FloatArray = np.concatenate([slope, slope[:, -1:]], axis=1)
    return np.clip(whole, -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD, out=whole)


def bounds_along(
    road: Road,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    travelled_m: FloatArray,
    half_width: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return (n, H + 1) smallest and largest offset at which a box stays on the drivable surface, m."""
    left, right = path_room(paths, road).at(
        np.repeat(row[:, None], travelled_m.shape[1], axis=1), s[:, None] + travelled_m
    )
    half = half_width[:, None]
    return _consistent(half - reached(right), reached(left) - half)


def _consistent(least: FloatArray, most: FloatArray) -> tuple[FloatArray, FloatArray]:
    middle, narrow = (most + least) / 2, most < least
    return np.where(narrow, middle, least), np.where(narrow, middle, most)


def plan_freely(history: SceneHistory, vehicles: VehicleIndex, free: FloatArray) -> Plan:
    """Take (n, H, 2) trajectories in the vehicles' frames unchanged, m, with headings along the motion."""
    step = np.diff(free, axis=1, prepend=np.zeros((len(vehicles), 1, 2)))
    moved = np.hypot(step[..., 0], step[..., 1])
    turn = _kept_headings(np.arctan2(step[..., 1], step[..., 0]), moved > STANDING_M)
    return map_plan(history, vehicles, free[..., 0], free[..., 1], turn, moved / STEP_S)


def _kept_headings(turn: FloatArray, moving: BoolArray) -> FloatArray:
    padded = np.concatenate([np.zeros((len(turn), 1)), turn], axis=1)
    step = np.where(moving, np.arange(1, turn.shape[1] + 1), 0)
    last = np.maximum.accumulate(step, axis=1)
    return np.asarray(np.take_along_axis(padded, last, axis=1))
