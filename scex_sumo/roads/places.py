"""Kinds of places on a road: ring, crossing, merge or lane; lanes ahead of lanes."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import headings, length_of, project, samples
from scex_sumo.road import Lane, Road
from scex_sumo.roads.conflicts import conflicts

MAX_RING_M = 400.0  # longer ways round are blocks of streets
REACH_M = MAX_RING_M + 100.0  # lanes further away than a ring is long say nothing about a place
MAX_STRAIGHT = 0.18  # share of a ring that is straight; sides of a square have nearly 0.25
STRAIGHT_RAD = 0.17
AROUND_M = 5.0
PLACES = ("ring", "crossing", "merge", "lane")


def places_of(road: Road, points: FloatArray) -> list[str | None]:
    """Return the kind of place of each point (N, 2), one of ``PLACES``; None off the lanes.

    A crossing or merge reaches 5 m beyond the conflict. An acceleration lane and the next lane are a merge.
    """
    rank = np.full(len(points), len(PLACES))
    road = _part(road, points)
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


def _part(road: Road, points: FloatArray) -> Road:
    """Return the part of a road that decides on points, by multiples of 500 m, if the road is far larger."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return road
    low, high = np.floor(points.min(axis=0) / REACH_M) - 1, np.ceil(points.max(axis=0) / REACH_M) + 1
    return _within(road, *(REACH_M * low).tolist(), *(REACH_M * high).tolist()) or road


@owner_cache
def _within(road: Road, left: float, bottom: float, right: float, top: float) -> Road | None:
    low, high = np.array([left, bottom]), np.array([right, top])
    near = {
        i: lane
        for i, lane in road.lanes.items()
        if (lane.centreline.min(axis=0) <= high).all() and (lane.centreline.max(axis=0) >= low).all()
    }
    return replace(road, lanes=near) if 2 * len(near) < len(road.lanes) else None


@owner_cache
def _rings(road: Road) -> frozenset[int]:
    lanes = road.vehicle_lanes
    length = {i: length_of(lane.centreline) for i, lane in lanes.items()}
    rings: set[int] = set()
    for i in lanes:
        loop = [] if i in rings else way_round(lanes, length, i)
        if loop and _is_round(np.vstack([lanes[j].centreline for j in loop])):
            rings.update(loop)
    return frozenset(rings)


def way_round(lanes: Mapping[int, Lane], length: Mapping[int, float], start: int) -> list[int]:
    """Return the lanes of the shortest way from a lane back to itself; empty if it is over 400 m."""
    queue: list[tuple[float, tuple[int, ...]]] = [(length[start], (start,))]
    reached: set[int] = set()
    while queue:
        far, route = heapq.heappop(queue)
        for after in lanes[route[-1]].successors:
            if after == start:
                return list(route)
            if after in length and after not in reached and far + length[after] <= MAX_RING_M:
                reached.add(after)
                heapq.heappush(queue, (far + length[after], (*route, after)))
    return []


def lanes_ahead(lanes: Mapping[int, Lane], ids: Iterable[int], reach_m: float) -> Iterator[int]:
    """Yield some lanes, then those that begin within ``reach_m`` behind their beginnings, nearest first."""
    queue = sorted((0.0, i) for i in ids)
    reached: set[int] = set()
    while queue:
        start, i = heapq.heappop(queue)
        if i in lanes and i not in reached and start <= reach_m:
            reached.add(i)
            yield i
            end = start + length_of(lanes[i].centreline)
            for j in lanes[i].successors:
                heapq.heappush(queue, (end, j))


def _is_round(loop: FloatArray) -> bool:
    points = samples(np.vstack([loop, loop[:1]]), 2.0)[1]  # twice round below: a straight may hold the start
    heading = np.unwrap(headings(np.vstack([points, points[1:]])))
    turned = np.abs(heading[None] - heading[: len(points), None]) > STRAIGHT_RAD
    after = np.arange(len(heading))[None] > np.arange(len(points))[:, None]
    straight = np.argmax(turned & after, axis=1) - np.arange(len(points))
    return bool(straight.max() <= MAX_STRAIGHT * len(points))


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
