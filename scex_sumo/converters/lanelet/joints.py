"""Joints that a map's author missed: lanes that end where another begins, but share no points with it.

Lanelet2 links lanelets by their shared end points alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.geometry.loose_ends import is_on
from scex_sumo.geometry.polylines import heading, turn
from scex_sumo.road import Lane

JOINT_M = 0.6  # from the end of one centreline to the beginning of the next: a careless click
ALIGNED_RAD = math.radians(15.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined:
    """Lanes with the joints that are plain to see.

    Attributes:
        lanes: all lanes by id.
        linked: ids of the lanes that got a lane before or after them.
        inside: lanes that still begin within other traffic.
    """

    lanes: dict[int, Lane]
    linked: tuple[int, ...]
    inside: tuple[int, ...]


def join_lanes(lanes: Mapping[int, Lane]) -> Joined:
    """Link vehicle lanes whose ends meet, aligned, where each has one partner and one of them has none yet.

    The loose end is moved to meet the other.
    """
    result = dict(lanes)
    driven = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    loose_starts = {i for i, lane in driven.items() if not lane.predecessors}
    loose_ends = {i for i, lane in driven.items() if not lane.successors}
    if not loose_starts and not loose_ends:
        return Joined(lanes=result, linked=(), inside=())
    pairs = _meetings(driven, loose_starts, loose_ends)
    for before, after in pairs:
        _link(result, before, after, move_start=after in loose_starts)
    linked = {i for pair in pairs for i in pair}
    inside = _inside(result, loose_starts - linked, (loose_starts | loose_ends) - linked)
    return Joined(lanes=result, linked=tuple(sorted(linked)), inside=inside)


def _meetings(lanes: Mapping[int, Lane], starts: set[int], ends: set[int]) -> list[tuple[int, int]]:
    """(before, after) of lanes whose ends meet, at least one of them loose and neither with a choice."""
    ids = list(lanes)
    first = np.array([lanes[i].centreline[0] for i in ids])
    last = np.array([lanes[i].centreline[-1] for i in ids])
    found = []
    for k, i in enumerate(ids):
        for m in np.flatnonzero(np.hypot(*(first - last[k]).T) < JOINT_M):
            j = ids[m]
            if i != j and (j in starts or i in ends) and _aligned(lanes[i], lanes[j]):
                found.append((i, j))
    befores, afters = [i for i, _ in found], [j for _, j in found]
    return [(i, j) for i, j in found if befores.count(i) == 1 and afters.count(j) == 1]


def _aligned(before: Lane, after: Lane) -> bool:
    bent = turn(heading(before.centreline, end=True), heading(after.centreline, end=False))
    alike = 0.6 < before.width_m / max(after.width_m, 0.1) < 1.7
    return abs(bent) < ALIGNED_RAD and alike and before.reverse_of != after.lane_id != before.lane_id


def _link(lanes: dict[int, Lane], before: int, after: int, *, move_start: bool) -> None:
    """Make one lane follow another."""
    one, other = lanes[before], lanes[after]
    if move_start:
        other = replace(other, centreline=_led(other.centreline, one.centreline[-1]))
    else:
        one = replace(one, centreline=_led(one.centreline[::-1], other.centreline[0])[::-1])
    lanes[before] = replace(one, successors=tuple(sorted({*one.successors, after})))
    lanes[after] = replace(other, predecessors=tuple(sorted({*other.predecessors, before})))
    for i, j in ((before, after), (after, before)):
        lanes[i] = replace(lanes[i], conflicts=tuple(k for k in lanes[i].conflicts if k != j))


def _led(line: FloatArray, start: FloatArray) -> FloatArray:
    """A polyline that begins elsewhere, without the points that lie behind its new beginning."""
    way = line[-1] - line[0] if len(line) == 2 else line[1] - line[0]
    ahead = line[1:][(line[1:] - start) @ way > 1e-3]
    return np.vstack([start, ahead if len(ahead) else line[-1:]])


def _inside(lanes: Mapping[int, Lane], starts: set[int], loose: set[int]) -> tuple[int, ...]:
    """Lanes without predecessors that begin on another lane, away from that one's own loose ends."""
    found = []
    for i in sorted(starts):
        others = [lanes[j] for j in lanes[i].conflicts if j in lanes]
        tip = lanes[i].centreline[0]
        if any(is_on(other.centreline, tip, loose_ends=other.lane_id in loose) for other in others):
            found.append(i)
    return tuple(found)
