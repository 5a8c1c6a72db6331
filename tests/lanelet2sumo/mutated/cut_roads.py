"""Roads whose lanes are cut into pieces, as some maps cut them into their intersections."""

from __future__ import annotations

from dataclasses import replace

from shapely import Polygon

from scex_sumo.geometry.polylines import cut, length_of, nearest
from scex_sumo.road import Lane, Road


def cut_road(road: Road, parts: int) -> Road:
    """A road with every vehicle lane in ``parts`` lanes of equal length; part k of lane i is parts * i + k.

    Only neighbours in the same part may be changed to; overlaps are guessed from those of the whole lanes.
    """
    lanes: dict[int, Lane] = {}
    for i, lane in road.vehicle_lanes.items():
        for k in range(parts):
            lanes[parts * i + k] = _part(lane, k, parts)
    lanes = {
        i: replace(
            lane,
            predecessors=tuple(j for j in lanes if i in lanes[j].successors),
            conflicts=tuple(j for j in lane.conflicts if overlap(lane, lanes[j])),
        )
        for i, lane in lanes.items()
    }
    rules = tuple(
        replace(
            rule,
            lanes=tuple(parts * i + k for i in rule.lanes for k in range(parts)),
            yielding=tuple(parts * i + k for i in rule.yielding for k in range(parts)),
            priority=tuple(parts * i + k for i in rule.priority for k in range(parts)),
        )
        for rule in road.regulations
    )
    return replace(road, lanes=lanes, regulations=rules)


def _part(lane: Lane, k: int, parts: int) -> Lane:
    length = length_of(lane.centreline)
    line = cut(lane.centreline, k * length / parts, (k + 1) * length / parts)
    bounds = []
    for bound in (lane.left_bound, lane.right_bound):
        ends = [0.0, *(nearest(bound, *line[at]) for at in (0, -1)), length_of(bound)]
        start, end = ends[1] if k else 0.0, ends[2] if k < parts - 1 else ends[3]
        bounds.append(cut(bound, start, max(end, start + 0.01)))

    def beside(other: int | None) -> int | None:
        return None if other is None else parts * other + k

    last = k == parts - 1
    return replace(
        lane,
        lane_id=parts * lane.lane_id + k,
        centreline=line,
        left_bound=bounds[0],
        right_bound=bounds[1],
        successors=tuple(parts * j for j in lane.successors) if last else (parts * lane.lane_id + k + 1,),
        left=beside(lane.left),
        right=beside(lane.right),
        adjacent_left=beside(lane.adjacent_left),
        adjacent_right=beside(lane.adjacent_right),
        conflicts=tuple(parts * j + m for j in lane.conflicts for m in range(parts)),
    )


def overlap(one: Lane, other: Lane) -> bool:
    """Whether the areas of two lanes share more than a touch."""
    areas = [Polygon([*lane.left_bound, *lane.right_bound[::-1]]).buffer(0.0) for lane in (one, other)]
    return float(areas[0].intersection(areas[1]).area) > 0.01
