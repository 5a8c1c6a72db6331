"""Conflicts of lanelets by geometry: crossing, merging, overlapping; independent of the net writer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import length_of
from scex_sumo.judge.matching import angle_between, sample_headings, sample_line
from scex_sumo.road import Lane

NEAR_M = 1.5  # centrelines this near: two cars (1.8 m wide) cannot pass there side by side
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trace:
    lane: Lane
    points: FloatArray
    line: shapely.LineString

    def near(self, line: shapely.LineString) -> FloatArray:
        off: FloatArray = shapely.distance(shapely.points(self.points), line)
        return off

    def area(self) -> shapely.Polygon:
        return shapely.Polygon(np.concatenate([self.lane.left_bound, self.lane.right_bound[::-1]])).buffer(
            0.0
        )


def find_conflicts(lanes: Mapping[int, Lane]) -> tuple[JudgedConflict, ...]:
    """Classify every pair of lanelets that come within a car's width of each other.

    Lanelets in a row, neighbours, branches of a fork, opposite directions that do not cross, and lanelets on
    different levels (not among ``Lane.conflicts``) are no conflicts.
    """
    lines = {i: shapely.LineString(lane.centreline) for i, lane in lanes.items()}
    traces = [
        _Trace(lane=lanes[i], points=sample_line(lanes[i].centreline, LOOK_M), line=line)
        for i, line in lines.items()
        if line.length > 0.0
    ]
    if not traces:
        return ()
    of_traces = [trace.line for trace in traces]
    near = shapely.STRtree(of_traces).query(of_traces, predicate="dwithin", distance=NEAR_M)
    pairs = ((traces[i], traces[j]) for i, j in near.T)
    found = (
        _classify(lanes, one, other)
        for one, other in pairs
        if one.lane.lane_id < other.lane.lane_id and not _beside(one.lane, other.lane)
    )
    return tuple(sorted((c for c in found if c is not None), key=lambda c: (c.first, c.second)))


def _beside(one: Lane, other: Lane) -> bool:
    mine, theirs = ({n.adjacent_left, n.adjacent_right, n.left, n.right} for n in (one, other))
    return other.lane_id in mine or one.lane_id in theirs


def _classify(lanes: Mapping[int, Lane], one: _Trace, other: _Trace) -> JudgedConflict | None:
    off = one.near(other.line)
    runs = [
        (_kind_of_run(lanes, one, other, start, end), start, end) for start, end in near_runs(off <= NEAR_M)
    ]
    kind = next((k for k in ("cross", "merge", "overlap") if any(k == run[0] for run in runs)), None)
    if kind is None:
        return None
    start, end = next((start, end) for found, start, end in runs if found == kind)
    at = start + int(np.argmin(off[start : end + 1]))
    partner = int(np.argmin(np.hypot(*(other.points - one.points[at]).T)))
    turned = float(angle_between(sample_headings(one.points)[at], sample_headings(other.points)[partner]))
    if abs(turned) > BACK_TO_BACK_RAD and (kind == "overlap" or not one.line.crosses(other.line)):
        return None  # no right of way helps where two lanelets run against each other
    if kind != "merge" and other.lane.lane_id not in one.lane.conflicts:
        return None  # a bridge: only the reader sees heights
    if kind == "overlap" and one.area().intersection(other.area()).area < OVERLAP_M2:
        return None
    return JudgedConflict(first=one.lane.lane_id, second=other.lane.lane_id, kind=kind, turn_rad=turned)


def near_runs(near: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(np.int8), [0]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def _kind_of_run(lanes: Mapping[int, Lane], one: _Trace, other: _Trace, start: int, end: int) -> str:
    a, b = one.lane, other.lane
    piece = shapely.LineString(one.points[[start, end] if end - start < 1 else slice(start, end + 1)])
    span = np.flatnonzero(other.near(piece) <= NEAR_M)
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
    if middle.length < NEAR_M and not middle.is_empty and piece.distance(middle) <= NEAR_M:
        return "cross"
    return "overlap"


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
    for depth in range(CHAIN + 1):
        if any(_share(one, other, end=end) for one, other in level):
            return True
        following = []
        for one, other in (*level, *(pair[::-1] for pair in level)) if depth < CHAIN else ():
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
    apart = float(np.hypot(*(tips[0] - tips[1])[-1 if end else 0]))
    ways = [np.arctan2(*(tip[1] - tip[0])[::-1]) for tip in tips]
    together = apart <= JOINT_M and abs(float(angle_between(*ways))) < BACK_TO_BACK_RAD
    return together or bool(set(_next(a, end=end)) & set(_next(b, end=end)))


def _next(lane: Lane, *, end: bool) -> tuple[int, ...]:
    return lane.successors if end else lane.predecessors
