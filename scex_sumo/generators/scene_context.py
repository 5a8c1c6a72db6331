"""Scene context: what a place on a lane knows of the road and of the vehicles placed before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import arc_lengths, wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.roads.relations import LaneRelations, road_index
from scex_sumo.roads.routes import centreline
from scex_sumo.scene import SeedScene, States

BEHIND_M, AHEAD_M = 80.0, 40.0  # of a lane's ends
CHORD_M = 3.0  # a lane's direction is that of its chord, because centrelines have kinks
FAR_M = 150.0
USUAL_LENGTH_M = 4.5
NEAR_M = (15.0, 40.0)
TURN_M = (20.0, 60.0)  # ahead, over which a lane's turn is a feature
FLOW_STEPS = 60
CURVE_MPS2, BRAKE_MPS2 = 2.5, 1.5  # usual in curves, and towards and after them
CURVES_M = np.arange(-40.0, 41.0, 10.0)  # around a place, at which curves count
MIN_PACE_MPS = 1.0
STANDING_MPS = 0.5

ROAD_COLUMNS: Final = (
    *("free", "width", "bend", "turn_20", "turn_60", "turned_20", "lanes", "from_right", "from_left"),
    *("entry", "exit", "meeting_ahead", "meeting_behind", "stop_ahead", "light_ahead", "stop_behind"),
    *("flow_in", "flow_out", "conflicts"),
)
SCENE_COLUMNS: Final = (
    *("gap", "leader_speed", "leader_standing", "leader_acceleration", "back_gap", "back_speed"),
    *("left_offset", "left_speed", "right_offset", "right_speed"),
    *("own_way", "other_way", "other_speed", "near_15", "near_40", "near_speed", "near_standing"),
    *("lane_ahead", "lane_speed", "all_speed", "all_standing"),
    *("placed", "density", "mean_length", "length_spread", "pace"),
    *("front_gap", "front_speed"),
)
COLUMNS: Final = (*ROAD_COLUMNS, *SCENE_COLUMNS)
NOBODY: Final[Mapping[str, float]] = {
    **dict.fromkeys(("gap", "back_gap", "own_way", "other_way"), float(np.log1p(FAR_M))),
    **dict.fromkeys(("left_offset", "right_offset"), float(np.log(41.0))),
    "front_gap": float(np.log(61.0)),
    **dict.fromkeys((c for c in SCENE_COLUMNS if c.endswith("_speed")), 1.0),
    **dict.fromkeys(("leader_standing", "leader_acceleration", "near_15", "near_40", "near_standing"), 0.0),
    **dict.fromkeys(("lane_ahead", "all_standing"), 0.0),
}
"""Features of a place on an empty road."""


Features: TypeAlias = dict[str, FloatArray | float]
Paths: TypeAlias = tuple[tuple[FloatArray, FloatArray], ...]
"""Arc lengths and points of each lane's path, from `BEHIND_M` before its start on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed(Rows):
    """Vehicles on lanes, (n,) each; ``lane`` counts the vehicle lanes by ascending id."""

    lane: IntArray
    s: FloatArray  # m, of the centre
    offset: FloatArray  # m to the left of the lane's centreline
    turn: FloatArray  # rad, heading minus the lane's
    speed: FloatArray  # m/s
    acceleration: FloatArray  # m/s², mean of the last second; NaN if that is not known
    length: FloatArray
    width: FloatArray
    kind: IntArray  # number of the type

    @property
    def pace(self) -> float:
        """Mean speed, at least `MIN_PACE_MPS`, m/s."""
        return max(float(self.speed.mean()), MIN_PACE_MPS)


NO_VEHICLES: Final = Placed(
    **{f.name: np.empty(0, np.int64 if f.name in ("lane", "kind") else np.float64) for f in fields(Placed)}  # type: ignore[arg-type]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneCells:
    """Vehicle lanes of a road as arrays: paths, and features of cells at most 1 m long.

    Attributes:
        cell_lane: (K,) lane of each cell; ``cell_s`` its middle, m.
        cell_m: (K,) length.
        first: (L + 1,) first cell of each lane.
        cell_pose: (3, K) x, y and heading of each middle.
        fixed: (K, ...) `ROAD_COLUMNS` of each cell.
    """

    relations: LaneRelations
    paths: Paths
    cell_lane: IntArray
    cell_s: FloatArray
    cell_m: FloatArray
    first: IntArray
    cell_pose: FloatArray
    fixed: FloatArray

    def poses(self, lane: IntArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y, heading of lanes (n,) at arc lengths (n, ...), which may lie beyond its ends."""
        return _poses(self.paths, lane, s)

    def quick_poses(self, lane: IntArray, s: FloatArray) -> States:
        """Return (n,) places on lanes, straight within a cell; without speeds."""
        cells = self.cells_at(lane, s)
        x, y, heading = self.cell_pose[:, cells]
        beyond_m = s - self.cell_s[cells]
        return States(
            x=x + beyond_m * np.cos(heading),
            y=y + beyond_m * np.sin(heading),
            heading=heading,
            speed=beyond_m,
        )

    def cells_at(self, lane: IntArray, s: FloatArray) -> IntArray:
        """Return the cells of (n,) places."""
        count = np.diff(self.first)[lane]
        share = s / self.relations.length[lane]
        return np.asarray(self.first[lane] + np.clip((share * count).astype(np.int64), 0, count - 1))


@owner_cache
def lane_cells(road: Road) -> LaneCells:
    """Return the lane cells of a road."""
    index = road_index(road)
    length = index.length
    lines = [
        centreline(road, (lane_id,), 0.0, BEHIND_M, total + AHEAD_M)[0]
        for lane_id, total in zip(index.lane_id.tolist(), length, strict=True)
    ]
    paths = tuple((arc_lengths(line), line) for line in lines)
    count = np.maximum(np.ceil(length).astype(np.int64), 1)
    first = np.concatenate([[0], np.cumsum(count)])
    cell_lane = np.repeat(np.arange(len(lines)), count)
    cell_m = (length / count)[cell_lane]
    cell_s = (np.arange(first[-1]) - first[cell_lane] + 0.5) * cell_m
    return LaneCells(
        relations=index,
        paths=paths,
        cell_lane=cell_lane,
        cell_s=cell_s,
        cell_m=cell_m,
        first=first,
        cell_pose=np.stack(_poses(paths, cell_lane, cell_s)),
        fixed=_road_features(road, paths, cell_lane, cell_s),
    )


def _poses(paths: Paths, lane: IntArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y, heading = np.empty(s.shape), np.empty(s.shape), np.empty(s.shape)
    chord = np.array([0.0, -CHORD_M, CHORD_M]).reshape(3, *(1,) * s.ndim)
    for k in np.unique(lane):
        on_lane, (arc, line) = lane == k, paths[k]
        along = s[on_lane] + BEHIND_M + chord
        (x[on_lane], x0, x1), (y[on_lane], y0, y1) = (np.interp(along, arc, column) for column in line.T)
        heading[on_lane] = np.arctan2(y1 - y0, x1 - x0)
    return x, y, heading


def _road_features(road: Road, paths: Paths, lane: IntArray, s: FloatArray) -> FloatArray:
    """Return (n, ...) `ROAD_COLUMNS` of places on lanes."""
    relations = road_index(road)
    length, lanes = relations.length, [road.lanes[i] for i in relations.lane_id.tolist()]
    number: dict[int | None, int] = {other.lane_id: k for k, other in enumerate(lanes)}
    after = [[number[i] for i in other.successors if i in number] for other in lanes]
    before = [[number[i] for i in other.predecessors if i in number] for other in lanes]
    entries = np.array([k for k, b in enumerate(before) if not b], np.int64)
    exits = np.array([k for k, a in enumerate(after) if not a], np.int64)
    stops = {i for r in road.regulations for i in r.yielding}
    stops |= {i for r in road.regulations if r.kind in ("stop", "yield") for i in r.lanes}
    lights = {i for r in road.regulations if r.kind == "traffic_light" for i in r.lanes}
    ends = [np.array(sorted(number[i] for i in of if i in number), np.int64) for of in (stops, lights)]
    places_m = [m[..., 0][m[..., 0] < total] for m, total in zip(relations.meeting, length, strict=True)]
    meetings = [np.unique([round(place_m, 1) for place_m in own.tolist()]) for own in places_m]
    meet_lane, meet_s = np.repeat(np.arange(len(lanes)), [len(m) for m in meetings]), np.concatenate(meetings)
    heading = _poses(paths, lane, s)[2]
    turned = [_poses(paths, lane, s + d)[2] for d in (*TURN_M, -TURN_M[0], -5.0, 5.0)]
    left, right = (_beside([number.get(other.beside[side], -1) for other in lanes]) for side in (0, 1))

    def onward(to: IntArray, to_s: FloatArray) -> FloatArray:
        return _log_least(_ways(relations, lane, s, to, to_s))

    def back(to: IntArray, to_s: FloatArray) -> FloatArray:
        return _log_least(_ways(relations, to, to_s, lane, s).T)

    columns = {
        "free": _free_speed(paths, lane, s, relations.speed_limit[lane]) / 10.0,
        "width": np.array([other.width_m for other in lanes])[lane],
        "bend": 10.0 * np.abs(wrap(turned[4] - turned[3])),
        "turn_20": wrap(turned[0] - heading),
        "turn_60": wrap(turned[1] - heading),
        "turned_20": wrap(turned[2] - heading),
        "lanes": (left + right + 1)[lane],
        "from_right": right[lane],
        "from_left": left[lane],
        "entry": back(entries, np.zeros(len(entries))),
        "exit": onward(exits, length[exits]),
        "meeting_ahead": onward(meet_lane, meet_s),
        "meeting_behind": back(meet_lane, meet_s),
        "stop_ahead": onward(ends[0], length[ends[0]]),
        "light_ahead": onward(ends[1], length[ends[1]]),
        "stop_behind": back(np.concatenate(ends), length[np.concatenate(ends)]),
        "flow_in": np.log(_flow(before, after))[lane],
        "flow_out": np.log(_flow(after, before))[lane],
        "conflicts": np.array([min(len(other.conflicts), 8) for other in lanes])[lane],
    }
    return np.column_stack([columns[name] for name in ROAD_COLUMNS]).astype(np.float64)


def _free_speed(paths: Paths, lane: IntArray, s: FloatArray, limit: FloatArray) -> FloatArray:
    """Return speeds (n,) m/s without other traffic: the limit, less in curves, before and after them."""
    squares = limit**2
    for away in CURVES_M:
        turned = wrap(_poses(paths, lane, s + away + 5.0)[2] - _poses(paths, lane, s + away - 5.0)[2])
        curve = CURVE_MPS2 * 10.0 / np.maximum(np.abs(turned), 1e-3)
        squares = np.minimum(squares, curve + 2.0 * BRAKE_MPS2 * abs(away))
    return np.sqrt(squares)


def _beside(table: list[int]) -> IntArray:
    """Return how many lanes lie on one side, at most 4."""
    count = np.zeros(len(table), np.int64)
    for k in range(len(table)):
        lane = k
        while (lane := table[lane]) >= 0 and count[k] < 4:
            count[k] += 1
    return count


def _flow(before: list[list[int]], after: list[list[int]]) -> FloatArray:
    """Return the traffic of each lane if each entry has the same and forks share it equally."""
    flow, count = np.ones(len(before)), np.array([len(b) for b in before])
    inside, head = count > 0, np.repeat(np.arange(len(before)), count)
    tail = np.array([p for b in before for p in b], np.int64)
    share = 1.0 / np.array([max(len(after[p]), 1) for p in tail])
    for _ in range(FLOW_STEPS):
        arrived = np.bincount(head, flow[tail] * share, len(flow))
        flow = np.where(inside, arrived, 1.0)
    return np.asarray(np.clip(flow, 0.01, 100.0))


def _log(distance_m: FloatArray) -> FloatArray:
    return np.asarray(np.log1p(np.minimum(distance_m, FAR_M)))


def _log_least(distance_m: FloatArray) -> FloatArray:
    """Return (n,) logarithms of the shortest of ways (n, m) that lead ahead."""
    return _log(np.where(distance_m >= 0, distance_m, np.inf).min(axis=1, initial=np.inf))


def _ways(r: LaneRelations, lane: IntArray, s: FloatArray, to: IntArray, to_s: FloatArray) -> FloatArray:
    """Return (n, m) ways from places to others along successors, m; negative if behind, inf without a way."""
    return np.asarray(r.ahead[lane[:, None], to] + to_s - s[:, None])


def place_features(
    table: LaneCells,
    lane: IntArray,
    s: FloatArray,
    others: Placed,
    *,
    vehicles: int,
    total_m: float,
    pace: float,
) -> FloatArray:
    """Return (n, F) `COLUMNS` of places among the vehicles placed before.

    Args:
        vehicles: number that the scene shall have on ``total_m`` of lanes.
        pace: mean speed that the scene shall have, m/s; other speeds are relative to it.
    """
    lengths = others.length if len(others.lane) else np.array([USUAL_LENGTH_M])
    columns: Features = {
        "placed": len(others.lane) / max(vehicles, 1),
        "density": np.log(1000.0 * vehicles / total_m),
        "mean_length": lengths.mean(),
        "length_spread": lengths.std(),
        "pace": np.log(pace),
    }
    if len(others.lane):
        ratio, standing = others.speed / pace, (others.speed < STANDING_MPS).astype(np.float64)
        columns |= {"all_speed": ratio.mean(), "all_standing": standing.mean()}
        columns |= _along(table.relations, lane, s, others, ratio, standing)
        columns |= _on_sides(table.relations, lane, s, others, ratio)
        columns |= _meeting(table.relations, lane, s, others, ratio)
        columns |= _around(table, lane, s, others, ratio, standing)
    else:
        columns |= NOBODY
    context = [np.broadcast_to(columns[name], len(lane)) for name in SCENE_COLUMNS]
    return np.column_stack([table.fixed[table.cells_at(lane, s)], *context])


def _nearest(distance_m: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
    """Return number and way of the nearest of (n, m), and whether it is nearer than `FAR_M`."""
    best = distance_m.argmin(axis=1)
    least = distance_m[np.arange(len(distance_m)), best]
    return best, least, np.isfinite(least) & (least < FAR_M)


def _along(
    r: LaneRelations, lane: IntArray, s: FloatArray, others: Placed, ratio: FloatArray, standing: FloatArray
) -> Features:
    """Features of leader, follower and vehicles ahead in the lanes of places."""
    half = (others.length + USUAL_LENGTH_M) / 2
    ahead, back = _ways(r, lane, s, others.lane, others.s), _ways(r, others.lane, others.s, lane, s).T
    ahead, back = np.where(ahead >= 0, ahead, np.inf), np.where(back > 0, back, np.inf)
    leader, distance_m, leads = _nearest(ahead)
    follower, back_way, follows = _nearest(back)
    soon = ahead < 60.0
    count = np.maximum(soon.sum(axis=1), 1)
    return {
        "gap": np.log1p(np.where(leads, np.maximum(distance_m - half[leader], 0.0), FAR_M)),
        "leader_speed": np.where(leads, ratio[leader], 1.0),
        "leader_standing": np.where(leads, standing[leader], 0.0),
        "leader_acceleration": np.where(leads, np.nan_to_num(others.acceleration)[leader], 0.0),
        "back_gap": np.log1p(np.where(follows, np.maximum(back_way - half[follower], 0.0), FAR_M)),
        "back_speed": np.where(follows, ratio[follower], 1.0),
        "lane_ahead": soon.sum(axis=1),
        "lane_speed": np.where(soon.any(axis=1), (soon * ratio).sum(axis=1) / count, 1.0),
    }


def _on_sides(r: LaneRelations, lane: IntArray, s: FloatArray, others: Placed, ratio: FloatArray) -> Features:
    """Features of the nearest vehicle in the lanes to the left and to the right of places."""
    pair = lane[:, None], others.lane
    beside = r.lead[pair] + r.stretch_b[pair] * others.s - r.stretch_a[pair] * s[:, None]
    columns: Features = {}
    for name, sign in (("left", 1), ("right", -1)):
        best, distance_m, has_vehicle = _nearest(np.where(r.side[pair] == sign, np.abs(beside), np.inf))
        has_vehicle &= distance_m < 40.0
        lead_m = np.where(has_vehicle, beside[np.arange(len(lane)), best], 40.0)
        columns[f"{name}_offset"] = np.sign(lead_m) * np.log1p(np.abs(lead_m))
        columns[f"{name}_speed"] = np.where(has_vehicle, ratio[best], 1.0)
    return columns


def _meeting(r: LaneRelations, lane: IntArray, s: FloatArray, others: Placed, ratio: FloatArray) -> Features:
    """Features of the vehicle whose lane meets that of a place after the shortest ways of both."""
    n, pair = len(lane), (lane[:, None], others.lane)
    own = r.meeting[pair][..., 0] - s[:, None, None]
    other = r.meeting[pair][..., 1] - others.s[:, None]
    soon = np.where((own > -5) & (other > -5), np.maximum(own, 0) + np.maximum(other, 0), np.inf)
    best, _, has_vehicle = _nearest(soon.reshape(n, -1))
    distances_m = (
        np.maximum(distance_m.reshape(n, -1)[np.arange(n), best], 0) for distance_m in (own, other)
    )
    own_m, other_m = (np.where(has_vehicle, distance_m, FAR_M) for distance_m in distances_m)
    return {
        "own_way": _log(own_m),
        "other_way": _log(other_m),
        "other_speed": np.where(has_vehicle, ratio[best // own.shape[2]], 1.0),
    }


def _around(
    table: LaneCells, lane: IntArray, s: FloatArray, others: Placed, ratio: FloatArray, standing: FloatArray
) -> Features:
    """Features of the vehicles near places, in whatever lanes, and straight ahead of them."""
    places, vehicles = table.quick_poses(lane, s), table.quick_poses(others.lane, others.s)
    apart = np.hypot(vehicles.x - places.x[:, None], vehicles.y - places.y[:, None])
    near = apart < NEAR_M[1]
    count = np.maximum(near.sum(axis=1), 1)
    front, left = places.ahead_and_left(vehicles.x[None], vehicles.y[None])
    best, distance_m, has_vehicle = _nearest(np.where((front > 0) & (np.abs(left) < 1.5), front, np.inf))
    has_vehicle &= distance_m < 60.0
    return {
        "near_15": (apart < NEAR_M[0]).sum(axis=1),
        "near_40": near.sum(axis=1),
        "near_speed": np.where(near.any(axis=1), (near * ratio).sum(axis=1) / count, 1.0),
        "near_standing": (near * standing).sum(axis=1) / count,
        "front_gap": np.log1p(np.where(has_vehicle, distance_m, 60.0)),
        "front_speed": np.where(has_vehicle, ratio[best], 1.0),
    }


def needed_deceleration(table: LaneCells, vehicles: Placed, others: Placed) -> FloatArray:
    """Return (n, m) m/s² by which the rear one of each pair must brake to the speed of the one ahead."""
    ahead = _ways(table.relations, vehicles.lane, vehicles.s, others.lane, others.s)
    back = _ways(table.relations, others.lane, others.s, vehicles.lane, vehicles.s).T
    closing = vehicles.speed[:, None] - others.speed
    half = (vehicles.length[:, None] + others.length) / 2
    needed = np.zeros(closing.shape)
    for distance_m, closes in ((ahead, closing), (back, -closing)):
        gap = np.where(distance_m > 0, np.maximum(distance_m - half, 0.1), np.inf)
        needed = np.maximum(needed, np.maximum(closes, 0.0) ** 2 / (2 * gap))
    return needed


def demands(table: LaneCells, vehicles: Placed) -> dict[str, FloatArray]:
    """Return what (n,) vehicles do that few recorded ones exceed, by name.

    ``lateral`` acceleration at the lane's curvature from 1 s before to 0.5 s after, m/s²; ``over_limit``, the
    speed over the limit; ``off_lane``, how far the body is beyond the lane's edge where no lane is beside it,
    m; ``on_crossing``, 1 for a vehicle that stands where another lane crosses or merges.
    """
    steady = replace(vehicles, acceleration=np.zeros_like(vehicles.speed))
    heading = states_of(table, steady, np.arange(-2.0, 2.0) / 2).heading
    fixed = table.fixed[table.cells_at(vehicles.lane, vehicles.s)]
    width, right, left = (fixed[:, ROAD_COLUMNS.index(c)] for c in ("width", "from_right", "from_left"))
    beside = np.where(vehicles.offset > 0, left, right) > 0
    distance_m = table.relations.meeting[vehicles.lane, ..., 0] - vehicles.s[:, None, None]
    over = (np.abs(distance_m) < vehicles.length[:, None, None] / 2).any(axis=(1, 2))
    return {
        "lateral": 2 * np.abs(wrap(np.diff(heading))).max(axis=1) * vehicles.speed,
        "over_limit": vehicles.speed / table.relations.speed_limit[vehicles.lane],
        "off_lane": np.where(beside, 0.0, np.abs(vehicles.offset) + (vehicles.width - width) / 2),
        "on_crossing": (over & (vehicles.speed < STANDING_MPS)).astype(np.float64),
    }


def states_of(table: LaneCells, vehicles: Placed, steps: FloatArray) -> States:
    """Return (n, T) states of vehicles along their lanes at times (T,) in s, with constant acceleration.

    The acceleration may be (n, T), one for each time. A vehicle that stands stays where it stands; one that
    starts has stood before.
    """
    v, a = vehicles.speed[:, None], np.nan_to_num(vehicles.acceleration)
    a = a if a.ndim == 2 else a[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        stop_s = np.where(a != 0, -v / a, -np.inf)  # when its speed is 0
    t = np.where(a > 0, np.maximum(steps, stop_s), np.where(a < 0, np.minimum(steps, stop_s), steps))
    t = np.where(v + a * steps <= 0, t, steps)
    travelled_m = v * t + a * t**2 / 2
    x, y, heading = table.poses(vehicles.lane, vehicles.s[:, None] + travelled_m)
    # The offset grows with the heading; so a vehicle moves where it points.
    offset = vehicles.offset[:, None] + np.tan(vehicles.turn)[:, None] * travelled_m
    return States(
        x=x - offset * np.sin(heading),
        y=y + offset * np.cos(heading),
        heading=wrap(heading + vehicles.turn[:, None]),
        speed=np.maximum(v + a * t, 0.0),
    )


def placed_on_lanes(
    scene: SeedScene, kinds: tuple[str, ...], rng: np.random.Generator
) -> tuple[Placed, IntArray]:
    """Return a scene's vehicles on lanes, each on one drawn among its matches, and their numbers.

    Accelerations are NaN for vehicles without a recorded second.
    """
    assert scene.road is not None
    road, now = scene.road, scene.now
    matches = match(road, now.x, now.y, now.heading)
    keys = np.log(matches.probability + 1e-12) + rng.gumbel(size=len(matches.vehicle))
    order = np.lexsort((-keys, matches.vehicle))
    vehicle, first = np.unique(matches.vehicle[order], return_index=True)
    chosen = order[first]
    lane = np.searchsorted(road_index(road).lane_id, matches.lane_id[chosen])
    s, table = matches.s[chosen], lane_cells(road)
    x, y, heading = table.poses(lane, s)
    dx, dy = now.x[vehicle] - x, now.y[vehicle] - y
    known = scene.recorded_steps[vehicle] == scene.history.shape[1] - 1
    past = scene.history.speed[vehicle]
    return Placed(
        lane=lane,
        s=np.clip(s + dx * np.cos(heading) + dy * np.sin(heading), 0.0, table.relations.length[lane]),
        offset=dy * np.cos(heading) - dx * np.sin(heading),
        turn=wrap(now.heading[vehicle] - heading),
        speed=past[:, -1],
        acceleration=np.where(known, past[:, -1] - past[:, 0], np.nan),
        length=scene.length[vehicle],
        width=scene.width[vehicle],
        kind=np.array([kinds.index(t) if (t := scene.types[v]) in kinds else 0 for v in vehicle]),
    ), vehicle
