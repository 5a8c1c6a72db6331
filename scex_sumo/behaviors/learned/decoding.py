"""Decoding of network outputs into plans: along a path, or free trajectories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import everyone
from scex_sumo.behaviors.driving.motion import JOIN_ANGLE_RAD, REAR_AXLE_SHARE, drive, map_plan
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.learned.surface import path_room
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

RETURN_S = 3.0  # time constant of returning to the path if no offset is wanted
EDGE_MARGIN_M = 0.15  # of the box to the edge of the drivable surface
SMOOTHING_STEPS = 4  # to both sides
STANDING_M = 0.01  # per step; below, a free trajectory keeps its heading


def plan_along(
    history: SceneHistory,
    who: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    acceleration: FloatArray,
    offset: FloatArray | None,
    *,
    road: Road | None = None,
    clear: bool = False,
) -> Plan:
    """Drive along paths with given accelerations and offsets.

    Args:
        acceleration: (n, H) m/s²; vehicles stop instead of reversing.
        offset: (n, H) wanted distance left of the path after each step, m; None returns to the path like
            exp(-t / RETURN_S).
        road: keeps every box on the drivable surface of this map; None does not.
        clear: also keeps it away from boxes beside it.
    """
    now = history.now[who.child, who.vehicle]
    s, present, _ = foot_points(paths, row, now.x, now.y, expected_way(history, who))
    steps, way = acceleration.shape[1], way_of(now.speed, acceleration)
    if offset is None:
        wanted = present[:, None] * np.exp(-STEP_S / RETURN_S * np.arange(steps + 1))
    else:
        wanted = np.concatenate([present[:, None], offset], axis=1)
    if road is None:
        wanted = _smoothed(wanted)
    else:
        least, most = _bounds(history, who, paths, row, s, way, road, clear=clear)
        # Bounding again would let offsets jump by centimetres, and steering follows their second derivative.
        wanted = _smoothed(np.clip(wanted, least, most))
    # the rear axle follows the path
    wanted = wanted - (REAR_AXLE_SHARE * history.scene.length[who.vehicle])[:, None] * _slope(wanted, way)

    return drive(history, who, paths, row, lambda step, *_: acceleration[:, step], steps=steps, aside=wanted)


def _bounds(
    history: SceneHistory,
    who: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    way: FloatArray,
    road: Road,
    *,
    clear: bool,
) -> tuple[FloatArray, FloatArray]:
    half = history.scene.width[who.vehicle] / 2 + EDGE_MARGIN_M
    least, most = bounds_along(road, paths, row, s, way, half)
    if not clear:
        return least, most
    right, left = offsets_beside(history, who, paths, row, s, way)
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
    way = np.zeros((len(speed), acceleration.shape[1] + 1))
    for step in range(acceleration.shape[1]):
        following = np.maximum(v + acceleration[:, step] * STEP_S, 0.0)
        way[:, step + 1] = way[:, step] + (v + following) * (STEP_S / 2)
        v = following
    return way


def _slope(offset: FloatArray, way: FloatArray) -> FloatArray:
    change, moved = np.diff(offset, axis=1), np.diff(way, axis=1)
    slope = np.where(moved > STANDING_M, change / np.maximum(moved, STANDING_M), 0.0)
    whole: FloatArray = np.concatenate([slope, slope[:, -1:]], axis=1)
    return np.clip(whole, -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD, out=whole)


def bounds_along(
    road: Road, paths: SeedPaths, row: IntArray, s: FloatArray, way: FloatArray, half_width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, H + 1) smallest and largest offset at which a box stays on the drivable surface, m."""
    left, right = path_room(paths, road).at(np.repeat(row[:, None], way.shape[1], axis=1), s[:, None] + way)
    half = half_width[:, None]
    return _consistent(half - reached(right), reached(left) - half)


def _consistent(least: FloatArray, most: FloatArray) -> tuple[FloatArray, FloatArray]:
    middle, narrow = (most + least) / 2, most < least
    return np.where(narrow, middle, least), np.where(narrow, middle, most)


def plan_freely(history: SceneHistory, who: VehicleIndex, free: FloatArray) -> Plan:
    """Take (n, H, 2) trajectories in the vehicles' frames unchanged, m, with headings along the motion."""
    step = np.diff(free, axis=1, prepend=np.zeros((len(who), 1, 2)))
    moved = np.hypot(step[..., 0], step[..., 1])
    turn = _kept_headings(np.arctan2(step[..., 1], step[..., 0]), moved > STANDING_M)
    return map_plan(history, who, free[..., 0], free[..., 1], turn, moved / STEP_S)


def _kept_headings(turn: FloatArray, moving: BoolArray) -> FloatArray:
    padded = np.concatenate([np.zeros((len(turn), 1)), turn], axis=1)
    step = np.where(moving, np.arange(1, turn.shape[1] + 1), 0)
    last = np.maximum.accumulate(step, axis=1)
    return np.asarray(np.take_along_axis(padded, last, axis=1))


NEAR_M = 25.0  # between centres of vehicles that can get beside each other within a plan
MARGIN_M = 0.4  # between two boxes
AHEAD_M = 1.0  # boxes this far ahead or behind count as beside
ALONG = 0.5  # sine of the angle to the path; at larger angles a vehicle crosses it
STRAIGHTENS_S, STRAIGHTENS_M = 1.0, 6.0  # after this time, at least this way, a third of an angle is left
OWN_DRIFT_S = 0.3  # the vehicle stops its own drift sooner
ASIDE_SPEED = 0.8  # m/s, lateral, towards a narrower place ahead
ASIDE_M, ASIDE_S = 0.5, 1.0  # largest shift, and its time constant, away from a box that is too near


@dataclass(frozen=True, kw_only=True, eq=False)
class _Boxes:
    s: FloatArray  # arc length of the centre, m
    offset: FloatArray  # of the centre from the path, m, left positive
    sine: FloatArray  # of the angle to the path
    ahead: FloatArray  # speed along the path, m/s
    along: FloatArray  # half extent along the path, m
    across: FloatArray  # half extent across it, m

    @classmethod
    def of(
        cls,
        paths: SeedPaths,
        row: IntArray,
        near: FloatArray,
        states: States,
        length: FloatArray,
        width: FloatArray,
    ) -> _Boxes:
        """Project boxes onto paths, near arc lengths."""
        s, offset, direction = foot_points(paths, row, states.x, states.y, near)
        turned = wrap(states.heading - direction)
        cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        return cls(
            s=s,
            offset=offset,
            sine=np.sin(turned),
            ahead=np.maximum(states.speed, 0.0) * np.cos(turned),
            along=(cos * length + sin * width) / 2,
            across=(cos * width + sin * length) / 2,
        )


def offsets_beside(
    history: SceneHistory, who: VehicleIndex, paths: SeedPaths, row: IntArray, s: FloatArray, way: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, H + 1) smallest and largest offset from the path, m; infinite without vehicles beside.

    Two boxes share the space between them; others keep their speed and straighten up.
    """
    everybody = everyone(history)
    now, others = history.now[who.child, who.vehicle], everybody.states[who.child]
    near = np.hypot(others.x - now.x[:, None], others.y - now.y[:, None]) < NEAR_M
    near &= everybody.present[who.child]
    near[np.arange(len(who)), who.vehicle] = False
    i, j = np.nonzero(near)
    own, other = (
        _Boxes.of(
            paths, row[i], s[i], everybody.states[who.child[i], k], everybody.length[k], everybody.width[k]
        )
        for k in (who.vehicle[i], j)
    )
    side = np.where(other.offset > own.offset, 1.0, -1.0)
    t: FloatArray = STEP_S * np.arange(way.shape[1], dtype=np.float64)
    ahead = (other.s - own.s)[:, None] + other.ahead[:, None] * t - way[i]
    along, apart = own.along + other.along, np.abs(other.offset - own.offset)
    beside = (np.abs(ahead[:, 0]) < along) | (apart > own.across + other.across)
    beside &= np.abs(other.sine) < ALONG
    counts = beside[:, None] & (np.abs(ahead) < along[:, None] + AHEAD_M)
    free = apart[:, None] - _taken(own, other, side, everybody.width[j], t) - MARGIN_M
    room = reached(np.where(counts, np.maximum(free / 2, -ASIDE_M), np.inf))
    room *= np.where(room < 0, 1 - np.exp(-t / ASIDE_S), 1.0)
    least, most = np.full(way.shape, -np.inf), np.full(way.shape, np.inf)
    left, right = side > 0, side < 0
    np.minimum.at(most, i[left], own.offset[left, None] + room[left])
    np.maximum.at(least, i[right], own.offset[right, None] - room[right])
    return least, most


def _taken(own: _Boxes, other: _Boxes, side: FloatArray, width: FloatArray, t: FloatArray) -> FloatArray:
    """Return (p, H + 1) distances across the path that the boxes occupy between their centres, m."""
    ahead = np.abs(other.ahead)
    straightens = np.maximum(STRAIGHTENS_S * ahead, STRAIGHTENS_M)
    left = np.exp(-ahead[:, None] * t / straightens[:, None])
    drift = np.maximum(-side * other.sine, 0.0) * straightens
    own_drift = np.maximum(side * own.ahead * own.sine, 0.0) * OWN_DRIFT_S
    turned, straight = other.across[:, None], (width / 2 + drift)[:, None]
    taken: FloatArray = (own.across + own_drift)[:, None] + straight + (turned - straight) * left
    return taken


def reached(room: FloatArray) -> FloatArray:
    """Return (n, H + 1) room from which the later room can be reached at `ASIDE_SPEED`."""
    reach = ASIDE_SPEED * STEP_S * np.arange(room.shape[1])
    reachable: FloatArray = np.minimum.accumulate((room + reach)[:, ::-1], axis=1)[:, ::-1] - reach
    return reachable
