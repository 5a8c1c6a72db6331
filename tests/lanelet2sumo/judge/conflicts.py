"""Conflicts of lanelets by geometry: crossing, merging, overlapping; independent of the net writer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray
from scex_sumo.geometry.polylines import length_of, samples, wrap
from scex_sumo.lanelet2sumo.judge.priority import NEAR_M
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import runs
from tests.lanelet2sumo.judge.by_geometry import sample_headings

JOINT_M = 0.3  # between coinciding ends
BACK_TO_BACK_RAD = np.deg2rad(150.0)  # from here on two lanelets run against each other
LOOK_M = 0.25  # sampling of the centrelines
CHAIN = 8  # lanelets to follow back to a fork or ahead to a merge
BRUSH_M = 1.0  # lanelets before a merge that come near for less than this only brush it
OVERLAP_M2 = 2.0  # shared area below which lanelets touch


@dataclass(frozen=True, kw_only=True)
class JudgedConflict:
    """Two lanelets that cannot be driven at once, ``first`` the smaller id.

    Attributes:
        kind: ``cross``, ``merge`` or ``overlap`` (side by side but too near, with no point in common).
        turn_rad: heading of the second minus that of the first where they meet, in [-pi, pi].
    """

    first: int
    second: int
    kind: str
    turn_rad: float


class _Trace:
    def __init__(self, lane: Lane) -> None:
        self.lane, self.id = lane, lane.lane_id
        self.line = shapely.LineString(lane.centreline)
        self.points = samples(lane.centreline, LOOK_M)[1]

    def near(self, line: shapely.LineString) -> BoolArray:
        return np.asarray(shapely.distance(shapely.points(self.points), line) <= NEAR_M)

    def area(self) -> shapely.Polygon:
        return shapely.Polygon(self.lane.outline).buffer(0.0)


def find_conflicts(lanes: Mapping[int, Lane]) -> tuple[JudgedConflict, ...]:
    """Classify every pair of lanelets that come within a car's width of each other.

    Lanelets in a row, neighbours, branches of a fork, opposite directions that do not cross, and lanelets on
    different levels (not among ``Lane.conflicts``) are no conflicts.
    """
    traces = [_Trace(lane) for _, lane in sorted(lanes.items()) if length_of(lane.centreline) > 0.0]
    lines = [trace.line for trace in traces]
    if not lines:
        return ()
    near = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=NEAR_M)
    pairs = ((traces[i], traces[j]) for i, j in sorted(near.T.tolist()) if i < j)
    judged = (_classify(lanes, one, other) for one, other in pairs if not _beside(one.lane, other.lane))
    return tuple(conflict for conflict in judged if conflict is not None)


def _beside(one: Lane, other: Lane) -> bool:
    mine, theirs = ({n.adjacent_left, n.adjacent_right, n.left, n.right} for n in (one, other))
    return other.lane_id in mine or one.lane_id in theirs


def _classify(lanes: Mapping[int, Lane], one: _Trace, other: _Trace) -> JudgedConflict | None:
    spans = {_kind(lanes, one, other, *span): span for span in reversed(runs(one.near(other.line)))}
    kind = next((kind for kind in ("cross", "merge", "overlap") if kind in spans), None)
    if kind is None:
        return None
    part = slice(spans[kind][0], spans[kind][1] + 1)
    at = part.start + int(np.argmin(shapely.distance(shapely.points(one.points[part]), other.line)))
    partner = int(np.argmin(np.hypot(*(other.points - one.points[at]).T)))
    turned = float(wrap(sample_headings(other.points)[partner] - sample_headings(one.points)[at]))
    if abs(turned) > BACK_TO_BACK_RAD and (kind == "overlap" or not one.line.crosses(other.line)):
        return None  # no right of way helps where two lanelets run against each other
    if kind != "merge" and other.id not in one.lane.conflicts:
        return None  # a bridge: only the reader sees heights
    if kind == "overlap" and one.area().intersection(other.area()).area < OVERLAP_M2:
        return None
    return JudgedConflict(first=one.id, second=other.id, kind=kind, turn_rad=turned)


def _kind(lanes: Mapping[int, Lane], one: _Trace, other: _Trace, start: int, end: int) -> str:
    a, b = one.lane, other.lane
    piece = shapely.LineString(one.points[[start, end] if end == start else slice(start, end + 1)])
    span = np.flatnonzero(other.near(piece))
    if not len(span):
        return "touch"
    begins = start == 0 or span[0] == 0
    ends = end == len(one.points) - 1 or span[-1] == len(other.points) - 1
    if begins and ends and (_in_a_row(lanes, a, b) or _in_a_row(lanes, b, a)):
        return "follow"
    if ends and _joined(lanes, a, b, end=True):
        length = min(end - start, len(span)) * LOOK_M
        return "merge" if length >= BRUSH_M or _share(a, b, end=True) else "touch"
    if begins and _joined(lanes, a, b, end=False):
        return "diverge"
    middle = one.line.intersection(other.line)
    crosses = middle.length < NEAR_M and not middle.is_empty and piece.distance(middle) <= NEAR_M
    return "cross" if crosses else "overlap"


def _in_a_row(lanes: Mapping[int, Lane], a: Lane, b: Lane) -> bool:
    reached, level = {a.lane_id}, [a]
    for _ in range(CHAIN + 1):
        ahead = {i for lane in level for i in lane.successors}
        if b.lane_id in ahead:
            return True
        level = [lanes[i] for i in ahead - reached if i in lanes and length_of(lanes[i].centreline) <= NEAR_M]
        reached |= ahead
    return False


def _joined(lanes: Mapping[int, Lane], a: Lane, b: Lane, *, end: bool) -> bool:
    reached, level = {frozenset((a.lane_id, b.lane_id))}, [(a, b)]
    for _ in range(CHAIN + 1):
        if any(_share(one, other, end=end) for one, other in level):
            return True
        following = []
        for one, other in (*level, *(pair[::-1] for pair in level)):
            tip = shapely.Point(one.centreline[-1 if end else 0])
            if tip.distance(shapely.LineString(other.centreline)) <= NEAR_M:
                for i in _next(one, end=end):
                    pair = frozenset((i, other.lane_id))
                    if i in lanes and len(pair) > 1 and pair not in reached:
                        reached.add(pair)
                        following.append((lanes[i], other))
        level = following
    return False


def _share(a: Lane, b: Lane, *, end: bool) -> bool:
    tips = [lane.centreline[-2:] if end else lane.centreline[:2] for lane in (a, b)]
    ways = [np.arctan2(*(tip[1] - tip[0])[::-1]) for tip in tips]
    apart = np.hypot(*(tips[0] - tips[1])[-1 if end else 0])
    together = apart <= JOINT_M and abs(wrap(ways[1] - ways[0])) < BACK_TO_BACK_RAD
    return bool(together) or not set(_next(a, end=end)).isdisjoint(_next(b, end=end))


def _next(lane: Lane, *, end: bool) -> tuple[int, ...]:
    return lane.successors if end else lane.predecessors
