"""Roundabouts: which lanes go round one, for maps that do not say who gives way there."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping

import numpy as np

from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Lane

LONGEST_M = 400.0  # round the largest roundabouts; blocks of houses are mostly larger
ROUND = 0.85  # area over that of a circle with the same circumference; a square has 0.79


def ring_lanes(lanes: Mapping[int, Lane]) -> frozenset[int]:
    """Lanes on a short, round cycle of successors.

    In a roundabout the ring has the right of way nearly everywhere, and right before left would lock it.
    """
    sizes = {i: length_of(lane.centreline) for i, lane in lanes.items()}
    found: set[int] = set()
    for i in sorted(_on_cycles(lanes)):
        if i not in found:
            cycle = _shortest_cycle(lanes, sizes, i)
            if cycle and _roundness(lanes, cycle) >= ROUND:
                found.update(cycle)
    return frozenset(found)


def _on_cycles(lanes: Mapping[int, Lane]) -> set[int]:
    """Lanes that may lie on a cycle: what is left when lanes that nothing follows are taken away in turn."""
    before: dict[int, list[int]] = {}
    left = {i: sum(j in lanes for j in lane.successors) for i, lane in lanes.items()}
    for i, lane in lanes.items():
        for j in lane.successors:
            before.setdefault(j, []).append(i)
    ends = [i for i, following in left.items() if not following]
    for i in ends:
        for j in before.get(i, ()):
            left[j] -= 1
            if not left[j]:
                ends.append(j)
    return lanes.keys() - ends


def _shortest_cycle(lanes: Mapping[int, Lane], sizes: Mapping[int, float], start: int) -> list[int]:
    """Lanes of the shortest way from a lane back to it, or nothing within the longest circumference."""
    queue: list[tuple[float, int, tuple[int, ...]]] = [(sizes[start], start, (start,))]
    done: set[int] = set()
    while queue:
        far, lane, way = heapq.heappop(queue)
        if far > LONGEST_M or lane in done:
            continue
        done.add(lane)
        for following in lanes[lane].successors:
            if following == start:
                return list(way)
            if following in lanes and following not in done:
                heapq.heappush(queue, (far + sizes[following], following, (*way, following)))
    return []


def _roundness(lanes: Mapping[int, Lane], cycle: list[int]) -> float:
    """Isoperimetric ratio of the centreline of a cycle: 1 for a circle."""
    points = np.vstack([lanes[i].centreline for i in cycle])
    closed = np.vstack([points, points[:1]])
    x, y = (closed - closed.mean(axis=0)).T
    area = abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2
    return 4 * math.pi * area / max(length_of(closed), 1e-9) ** 2
