"""Lanes ahead of lanes, by distance."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping

from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Lane


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
