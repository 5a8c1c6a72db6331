"""Overlaps of lanes' areas, for maps whose format does not say which do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.road import Lane

TOUCH_M = 0.1  # how far two mapped areas may reach into each other from either side and merely touch
CLEARANCE_M = 3.0  # lanes this far above one another do not conflict; bridges leave 4.5 m and more


def overlapping(lanes: Mapping[int, Lane], centres: Mapping[int, FloatArray]) -> dict[int, Lane]:
    """The same lanes with ``conflicts`` set: vehicle lanes that share ground and are not otherwise related.

    As in Lanelet2's routing graph, lanes that follow one another or lie side by side in the same direction
    do not conflict, and lanes on different levels do not either.

    Args:
        lanes: of every kind, connected.
        centres: (P, 3) centreline with heights by lane id, or (P, 2) where they are not known.
    """
    ids = [i for i, lane in lanes.items() if lane.kind == "vehicle"]
    areas = [_area(lanes[i]) for i in ids]
    found: dict[int, set[int]] = {i: set() for i in ids}
    if ids:
        pairs = shapely.STRtree(areas).query(areas, predicate="intersects")
        for one, other in pairs.T:
            a, b = ids[one], ids[other]
            if a < b and not _related(lanes[a], lanes[b]):
                shared = shapely.centroid(shapely.intersection(areas[one], areas[other]))
                if _on_one_level(centres[a], centres[b], shared):
                    found[a].add(b)
                    found[b].add(a)
    return {i: replace(lane, conflicts=tuple(sorted(found.get(i, ())))) for i, lane in lanes.items()}


def _area(lane: Lane) -> shapely.Geometry:
    """Ground between the bounds, less a narrow rim; valid even where the bounds cross."""
    ring = np.concatenate([lane.right_bound, lane.left_bound[::-1]])
    return shapely.make_valid(shapely.Polygon(ring)).buffer(-TOUCH_M)


def _related(a: Lane, b: Lane) -> bool:
    beside = (a.adjacent_left, a.adjacent_right, a.reverse_of)
    return a.lane_id == b.reverse_of or b.lane_id in (*beside, *a.successors, *a.predecessors)


def _on_one_level(a: FloatArray, b: FloatArray, where: shapely.Point) -> bool:
    if a.shape[1] < 3 or b.shape[1] < 3 or where.is_empty:
        return True
    place = np.array([where.x, where.y])
    levels = [line[np.argmin(np.hypot(*(line[:, :2] - place).T)), 2] for line in (a, b)]
    return abs(float(levels[0] - levels[1])) < CLEARANCE_M
