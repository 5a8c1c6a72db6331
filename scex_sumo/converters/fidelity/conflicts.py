"""Which lanelets are in each other's way, from their geometry alone: crossing, merging, overlapping.

The net writer has its own classification; this one shares nothing with it, so that either can find the other
wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.converters.fidelity.matching import headings, sample
from scex_sumo.road import Lane

NEAR_M = 1.5  # centrelines this near: two cars (1.8 m wide) cannot pass there side by side
JOINT_M = 0.3  # ends that coincide; mapped ends of one fork or merge share nodes, repaired ones nearly
BACK_TO_BACK_RAD = np.deg2rad(150.0)  # from here on two lanelets run against each other
LOOK_M = 0.25  # sampling of the centrelines
CHAIN = 4  # lanelets to follow back to a fork or ahead to a merge
BRUSH_M = 1.0  # lanelets before a merge that come near for less than this only brush it
OVERLAP_M2 = 2.0  # shared area below which lanelets touch


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """Two lanelets that cannot be driven at once.

    Attributes:
        first: the smaller id.
        second: the greater id.
        kind: ``cross``, ``merge`` or ``overlap`` (side by side but too near, with no point in common).
        turn_rad: heading of the second minus that of the first where they come together, in [-pi, pi].
        at_ends: the lanelets touch only with their last metres.
    """

    first: int
    second: int
    kind: str
    turn_rad: float
    at_ends: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trace:
    """A lanelet sampled, with the direction of each point."""

    lane: Lane
    points: FloatArray
    directions: FloatArray
    line: shapely.LineString
    area: shapely.Polygon


def find_conflicts(lanes: Mapping[int, Lane]) -> tuple[Conflict, ...]:
    """Classify every pair of lanelets that come within a car's width of each other.

    Pairs that follow one another, lie beside each other as neighbours, or only leave the same fork are no
    conflict; nor are lanelets that run against each other without crossing, or that the map's reader holds to
    lie on different levels (they cross here and are not among ``Lane.conflicts``).
    """
    traces = {
        i: _trace(lane) for i, lane in lanes.items() if shapely.LineString(lane.centreline).length > 0.0
    }
    ids = list(traces)
    lines = [traces[i].line for i in ids]
    if not lines:
        return ()
    near = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=NEAR_M)
    found = []
    for one, other in near.T:
        first, second = ids[one], ids[other]
        if first < second and not _related(lanes[first], lanes[second]):
            conflict = _classify(lanes, traces[first], traces[second])
            if conflict is not None:
                found.append(conflict)
    return tuple(sorted(found, key=lambda conflict: (conflict.first, conflict.second)))


def _trace(lane: Lane) -> _Trace:
    points = sample(lane.centreline, LOOK_M)
    area = shapely.Polygon(np.concatenate([lane.left_bound, lane.right_bound[::-1]])).buffer(0.0)
    return _Trace(
        lane=lane,
        points=points,
        directions=headings(points),
        line=shapely.LineString(lane.centreline),
        area=area,
    )


def _related(one: Lane, other: Lane) -> bool:
    beside = (one.adjacent_left, one.adjacent_right, one.left, one.right)
    beside_other = (other.adjacent_left, other.adjacent_right, other.left, other.right)
    return other.lane_id in beside or one.lane_id in beside_other


def _classify(lanes: Mapping[int, Lane], one: _Trace, other: _Trace) -> Conflict | None:
    off = shapely.distance(shapely.points(one.points), other.line)
    runs = _runs(off <= NEAR_M)
    best: tuple[int, str, int, bool] | None = None
    ranks = {"cross": 3, "merge": 2, "overlap": 1}
    for start, end in runs:
        kind, at_ends = _kind_of_run(lanes, one, other, start, end)
        if kind in ranks and (best is None or ranks[kind] > best[0]):
            best = ranks[kind], kind, start + int(np.argmin(off[start : end + 1])), at_ends
    if best is None:
        return None
    _, kind, at, at_ends = best
    partner = int(np.argmin(np.hypot(*(other.points - one.points[at]).T)))
    turn = float(np.angle(np.exp(1j * (other.directions[partner] - one.directions[at]))))
    if abs(turn) > BACK_TO_BACK_RAD and (kind == "overlap" or not one.line.crosses(other.line)):
        return None  # no right of way helps where two lanelets run against each other
    if kind != "merge" and other.lane.lane_id not in one.lane.conflicts:
        return None  # a bridge: the reader has seen heights, which are no longer there
    if kind == "overlap" and one.area.intersection(other.area).area < OVERLAP_M2:
        return None
    return Conflict(
        first=one.lane.lane_id, second=other.lane.lane_id, kind=kind, turn_rad=turn, at_ends=at_ends
    )


def _runs(near: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(np.int8), [0]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def _kind_of_run(
    lanes: Mapping[int, Lane], one: _Trace, other: _Trace, start: int, end: int
) -> tuple[str, bool]:
    """What the two lanelets do between two samples of the first; also whether only at their ends."""
    a, b = one.lane, other.lane
    piece = shapely.LineString(one.points[[start, end] if end - start < 1 else slice(start, end + 1)])
    theirs = shapely.distance(shapely.points(other.points), piece) <= NEAR_M
    span = np.flatnonzero(theirs)
    if not len(span):
        return "touch", False
    begins = start == 0 or span[0] == 0
    ends = end == len(one.points) - 1 or span[-1] == len(other.points) - 1
    if begins and ends and (_in_a_row(lanes, a, b, CHAIN) or _in_a_row(lanes, b, a, CHAIN)):
        return "follow", False
    if ends and _merged(lanes, a, b, CHAIN):
        length = min((end - start) * LOOK_M, len(span) * LOOK_M)
        direct = _share_end(a, b)
        at_ends = length < 2 * BRUSH_M + NEAR_M
        return ("merge" if direct or length >= BRUSH_M else "touch"), at_ends
    if begins and _parted(lanes, a, b, CHAIN):
        return "diverge", False
    middle = one.line.intersection(other.line)
    if middle.length < NEAR_M and not middle.is_empty and piece.distance(middle) <= NEAR_M:
        return "cross", False
    return "overlap", False


def _in_a_row(lanes: Mapping[int, Lane], a: Lane, b: Lane, depth: int) -> bool:
    """Whether the second follows the first, at once or after lanelets too short to keep them apart."""
    if b.lane_id in a.successors:
        return True
    ahead = [lanes[i] for i in a.successors if i in lanes and i != a.lane_id]
    short = [lane for lane in ahead if shapely.LineString(lane.centreline).length <= NEAR_M]
    return depth > 0 and any(_in_a_row(lanes, lane, b, depth - 1) for lane in short)


def _share_end(a: Lane, b: Lane) -> bool:
    together = float(np.hypot(*(a.centreline[-1] - b.centreline[-1]))) <= JOINT_M
    together &= _turn(a.centreline[-2:], b.centreline[-2:]) < BACK_TO_BACK_RAD
    return together or bool(set(a.successors) & set(b.successors))


def _share_start(a: Lane, b: Lane) -> bool:
    together = float(np.hypot(*(a.centreline[0] - b.centreline[0]))) <= JOINT_M
    together &= _turn(a.centreline[:2], b.centreline[:2]) < BACK_TO_BACK_RAD
    return together or bool(set(a.predecessors) & set(b.predecessors))


def _merged(lanes: Mapping[int, Lane], a: Lane, b: Lane, depth: int) -> bool:
    """Whether both lead into one lanelet while they stay near each other."""
    if _share_end(a, b):
        return True
    return depth > 0 and (_merges_ahead(lanes, a, b, depth) or _merges_ahead(lanes, b, a, depth))


def _merges_ahead(lanes: Mapping[int, Lane], a: Lane, b: Lane, depth: int) -> bool:
    if _gap(a.centreline[-1], b) > NEAR_M:
        return False
    ahead = (lanes[i] for i in a.successors if i in lanes and i != b.lane_id)
    return any(_merged(lanes, lane, b, depth - 1) for lane in ahead)


def _parted(lanes: Mapping[int, Lane], a: Lane, b: Lane, depth: int) -> bool:
    """Whether both come from one fork and have stayed near each other since."""
    if _share_start(a, b):
        return True
    return depth > 0 and (_parts_behind(lanes, a, b, depth) or _parts_behind(lanes, b, a, depth))


def _parts_behind(lanes: Mapping[int, Lane], a: Lane, b: Lane, depth: int) -> bool:
    if _gap(a.centreline[0], b) > NEAR_M:
        return False
    behind = (lanes[i] for i in a.predecessors if i in lanes and i != b.lane_id)
    return any(_parted(lanes, lane, b, depth - 1) for lane in behind)


def _gap(point: FloatArray, lane: Lane) -> float:
    return float(shapely.distance(shapely.Point(point), shapely.LineString(lane.centreline)))


def _turn(one: FloatArray, other: FloatArray) -> float:
    """Angle in [0, pi] between two pieces of line."""
    ways = (one[-1] - one[0], other[-1] - other[0])
    angles = [float(np.arctan2(way[1], way[0])) for way in ways]
    return abs(float(np.angle(np.exp(1j * (angles[1] - angles[0])))))
