"""Borders of the map: lanes that fork or join there get a short common road.

Without it SUMO does not notice that such lanes overlap, and inserts vehicles into each other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from scex_sumo.geometry.polylines import cut, heading, length_of, wrap
from scex_sumo.lanelet2sumo.topology.rows import SHORTEST_M, STUB_M
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
    for end in (False, True):
        for group in _groups(result, end=end):
            result |= _joined(result, group, next(ids), end=end)
    return result


def add_approaches(
    lanes: Mapping[int, Lane], conflicts: Iterable[Conflict], taken: Collection[int] = ()
) -> dict[int, Lane]:
    """Add an entry before each lane that begins in the way of another one."""
    result, ids = dict(lanes), _fresh(lanes, taken)
    early = {i for c in conflicts for i, (start, _) in zip(c.lanes, c.spans, strict=True) if start < STUB_M}
    for lane in sorted(early - _changing(lanes)):
        if not lanes[lane].predecessors and length_of(lanes[lane].centreline) > 10 * SHORTEST_M:
            result |= _joined(result, [lane], next(ids), end=False)
    return result


def _joined(lanes: Mapping[int, Lane], group: Sequence[int], fresh: int, *, end: bool) -> dict[int, Lane]:
    first = lanes[group[0]]
    sizes = {i: length_of(lanes[i].centreline) for i in group}
    if end:
        line = cut(first.centreline, sizes[group[0]] - SHORTEST_M, sizes[group[0]])
    else:
        line = cut(first.centreline, 0.0, SHORTEST_M)
        along = (line[1] - line[0]) / float(np.hypot(*(line[1] - line[0])))
        line = np.vstack([line[0] - ROOM_M * along, line])
    step = line[-1] - line[0]
    across = first.width_m / 2 * np.array([-step[1], step[0]]) / float(np.hypot(*step))
    result = {
        fresh: replace(
            first,
            lane_id=fresh,
            subtype=ENTRY,
            centreline=line,
            left_bound=line + across,
            right_bound=line - across,
            successors=() if end else tuple(group),
            predecessors=tuple(group) if end else (),
            conflicts=(),
        )
    }
    for i, size in sizes.items():
        rest = cut(lanes[i].centreline, *((0.0, size - SHORTEST_M) if end else (SHORTEST_M, size)))
        lane = replace(lanes[i], centreline=rest)
        result[i] = replace(lane, successors=(fresh,)) if end else replace(lane, predecessors=(fresh,))
    return result


def _fresh(lanes: Collection[int], taken: Collection[int]) -> Iterator[int]:
    return (i for i in count(max([0, *lanes]) + 1) if i not in taken)


def _changing(lanes: Mapping[int, Lane]) -> set[int]:
    beside = {i for lane in lanes.values() for i in (lane.left, lane.right) if i is not None}
    return beside | {i for i, lane in lanes.items() if lane.left is not None or lane.right is not None}


def _groups(lanes: Mapping[int, Lane], *, end: bool) -> list[list[int]]:
    changing = _changing(lanes)
    ends = {
        i: x.centreline for i, x in sorted(lanes.items()) if not (x.successors if end else x.predecessors)
    }
    loose = {i: x for i, x in ends.items() if i not in changing and length_of(x) > 10 * SHORTEST_M}
    ids, groups = list(loose), list[list[int]]()
    tips = np.array([line[-1 if end else 0] for line in loose.values()]).reshape(-1, 2)
    angles = np.array([heading(line, end=end, reach=1.0) for line in loose.values()])
    left = np.ones(len(ids), dtype=np.bool_)
    for k in range(len(ids)):
        near = left & (np.hypot(*(tips - tips[k]).T) < TOGETHER_M)
        near &= np.abs(wrap(angles - angles[k])) < ALIGNED
        if left[k] and near.sum() > 1:
            groups.append([ids[j] for j in np.flatnonzero(near)])
            left &= ~near
    return groups
