"""Borders of the map: lanes that fork or join there get a short common road.

Without it SUMO does not notice that such lanes overlap, and inserts vehicles into each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.topology.graph import SHORTEST_M, STUB_M
from scex_sumo.geometry.polylines import cut, heading, length_of, turn
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

ENTRY = "entry"  # subtype of such a lane
ROOM_M = 1.9
TOGETHER_M = 0.08
ALIGNED = math.radians(20.0)


def add_entries(lanes: Mapping[int, Lane], taken: Collection[int] = ()) -> dict[int, Lane]:
    """Add a short common lane where vehicle lanes begin, or end, at one point of the border.

    ``taken`` are ids that new lanes must not get.
    """
    result = dict(lanes)
    ids = _fresh(lanes, taken)
    for group in _groups(lanes, lambda lane: not lane.predecessors, end=False):
        result |= _entered(result, group, next(ids))
    for group in _groups(result, lambda lane: not lane.successors, end=True):
        line = result[group[0]].centreline
        last, fresh = cut(line, length_of(line) - SHORTEST_M, length_of(line)), next(ids)
        result[fresh] = _piece(result[group[0]], fresh, last, predecessors=tuple(group))
        for i in group:
            line = result[i].centreline
            rest = cut(line, 0.0, length_of(line) - SHORTEST_M)
            result[i] = replace(result[i], centreline=rest, successors=(fresh,))
    return result


def add_approaches(
    lanes: Mapping[int, Lane], found: Iterable[Conflict], taken: Collection[int] = ()
) -> dict[int, Lane]:
    """Add an entry before each lane that begins in the way of another one."""
    result = dict(lanes)
    changing = _changing(lanes)
    ids = _fresh(lanes, taken)
    blocked = {
        lane
        for c in found
        for lane, (start, _) in zip(c.lanes, c.spans, strict=True)
        if start < STUB_M and not lanes[lane].predecessors and lane not in changing
    }
    for lane in sorted(blocked):
        if length_of(lanes[lane].centreline) > 10 * SHORTEST_M:
            result |= _entered(result, [lane], next(ids))
    return result


def _entered(lanes: Mapping[int, Lane], group: Sequence[int], fresh: int) -> dict[int, Lane]:
    first = lanes[group[0]]
    line = _prolonged(cut(first.centreline, 0.0, SHORTEST_M))
    result = {fresh: _piece(first, fresh, line, successors=tuple(group))}
    for i in group:
        line = lanes[i].centreline
        rest = cut(line, SHORTEST_M, length_of(line))
        result[i] = replace(lanes[i], centreline=rest, predecessors=(fresh,))
    return result


def _fresh(lanes: Collection[int], taken: Collection[int]) -> Iterator[int]:
    return (i for i in count(max([0, *lanes]) + 1) if i not in taken)


def _changing(lanes: Mapping[int, Lane]) -> set[int]:
    beside = {i for lane in lanes.values() for i in (lane.left, lane.right) if i is not None}
    return beside | {i for i, lane in lanes.items() if lane.left is not None or lane.right is not None}


def _groups(lanes: Mapping[int, Lane], loose: Callable[[Lane], bool], *, end: bool) -> list[list[int]]:
    tips: list[tuple[int, FloatArray, float]] = []
    changing = _changing(lanes)
    for i, lane in sorted(lanes.items()):
        if loose(lane) and i not in changing and length_of(lane.centreline) > 10 * SHORTEST_M:
            tip = lane.centreline[-1 if end else 0]
            tips.append((i, tip, heading(lane.centreline, end=end, reach=1.0)))
    groups: list[list[int]] = []
    taken: set[int] = set()
    places = np.array([tip for _, tip, _ in tips]).reshape(-1, 2)
    for i, tip, angle in tips:
        if i in taken:
            continue
        group = [
            j
            for j, other, other_angle in (tips[k] for k in _beside(places, tip))
            if j not in taken
            and math.dist(tip, other) < TOGETHER_M
            and abs(turn(angle, other_angle)) < ALIGNED
        ]
        if len(group) > 1:
            groups.append(group)
            taken.update(group)
    return groups


def _beside(places: FloatArray, tip: FloatArray) -> list[int]:
    found: list[int] = np.flatnonzero((np.abs(places - tip) < TOGETHER_M).all(axis=1)).tolist()
    return found


def _prolonged(line: FloatArray) -> FloatArray:
    along = (line[1] - line[0]) / float(np.hypot(*(line[1] - line[0])))
    return np.vstack([line[0] - ROOM_M * along, line])


def _piece(
    lane: Lane,
    lane_id: int,
    centreline: FloatArray,
    *,
    successors: tuple[int, ...] = (),
    predecessors: tuple[int, ...] = (),
) -> Lane:
    step = centreline[-1] - centreline[0]
    across = lane.width_m / 2 * np.array([-step[1], step[0]]) / float(np.hypot(*step))
    return replace(
        lane,
        lane_id=lane_id,
        subtype=ENTRY,
        centreline=centreline,
        left_bound=centreline + across,
        right_bound=centreline - across,
        successors=successors,
        predecessors=predecessors,
        conflicts=(),
    )
