"""Kinds of places on a road: ring, crossing, merge or lane."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.geometry.polylines import project
from scex_sumo.road import Road
from scex_sumo.roads.conflicts import conflicts
from scex_sumo.roads.relations import ways_round

MAX_RING_M = 400.0  # longer ways round are blocks of streets
AROUND_M = 5.0
PLACES = ("ring", "crossing", "merge", "lane")


def places_of(road: Road, points: FloatArray) -> list[str | None]:
    """Return the kind of place of each point (N, 2), one of ``PLACES``; None off the lanes.

    A crossing or merge reaches 5 m beyond the lanes' conflict. An acceleration lane and the next lane are a
    merge.
    """
    rank = np.full(len(points), len(PLACES))
    rings, meetings = _rings(road), _meetings(road)
    for lane in road.vehicle_lanes.values():
        low, high = lane.centreline.min(axis=0) - lane.width_m, lane.centreline.max(axis=0) + lane.width_m
        near = np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))
        if near.size == 0:
            continue
        along, aside = project(points[near], lane.centreline)
        on, along = near[aside <= lane.width_m / 2], along[aside <= lane.width_m / 2]
        rank[on] = np.minimum(rank[on], PLACES.index("ring" if lane.lane_id in rings else "lane"))
        for kind, start, end in meetings.get(lane.lane_id, ()):
            here = on[(along >= start - AROUND_M) & (along <= end + AROUND_M)]
            rank[here] = np.minimum(rank[here], PLACES.index(kind))
    return [PLACES[k] if k < len(PLACES) else None for k in rank.tolist()]


@owner_cache
def _rings(road: Road) -> frozenset[int]:
    lanes = list(road.vehicle_lanes.values())
    short = ways_round(lanes) <= MAX_RING_M
    return frozenset(lane.lane_id for lane, ring in zip(lanes, short.tolist(), strict=True) if ring)


@owner_cache
def _meetings(road: Road) -> dict[int, list[tuple[str, float, float]]]:
    words = {"cross": "crossing", "merge": "merge"}
    meetings: dict[int, list[tuple[str, float, float]]] = {}
    lanes = road.vehicle_lanes
    for conflict in conflicts(lanes):
        if conflict.kind in words:
            for number, (start, end) in zip(conflict.lanes, conflict.spans, strict=True):
                meetings.setdefault(number, []).append((words[conflict.kind], start, end))
    for lane in lanes.values():  # an acceleration lane ends beside another lane
        for beside in (lane.left, lane.right):
            if beside in lanes and lanes[beside].successors and not lane.successors:
                for number in (lane.lane_id, beside):
                    meetings.setdefault(number, []).append(("merge", 0.0, np.inf))
    return meetings
