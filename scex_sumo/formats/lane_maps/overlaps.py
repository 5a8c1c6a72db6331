"""Overlaps of lanes of maps that are not Lanelet2's, which finds them itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Lane

TOUCH_M = 0.1  # areas that overlap by less than twice this only touch
MIN_HEADROOM_M = 3.0  # bridges leave 4.5 m and more


def overlapping(lanes: Mapping[int, Lane], centres: Mapping[int, FloatArray]) -> dict[int, Lane]:
    """Return the lanes with ``conflicts`` set: vehicle lanes whose areas overlap.

    As in Lanelet2, lanes do not conflict if they follow one another, lie side by side in one direction, or
    lie on different levels.

    Args:
        centres: centreline by lane id, (P, 3) with heights or (P, 2).
    """
    ids = [i for i, lane in lanes.items() if lane.kind == "vehicle"]
    rings = [np.concatenate([lanes[i].right_bound, lanes[i].left_bound[::-1]]) for i in ids]
    areas = shapely.make_valid([shapely.Polygon(ring) for ring in rings])
    areas = shapely.buffer(areas, -TOUCH_M, quad_segs=16)
    # Without heights: low is inf, high is -inf.
    low = {i: line[:, 2:].min(initial=np.inf) for i, line in centres.items()}
    high = {i: line[:, 2:].max(initial=-np.inf) for i, line in centres.items()}
    overlaps: dict[int, set[int]] = {i: set() for i in ids}
    for one, other in shapely.STRtree(areas).query(areas, predicate="intersects").T.tolist():
        a, b = ids[one], ids[other]
        if a < b and not _follow_or_neighbour(lanes[a], lanes[b]):
            level = max(high[a] - low[b], high[b] - low[a]) < MIN_HEADROOM_M
            if level or _on_one_level(centres[a], centres[b], shapely.intersection(areas[one], areas[other])):
                overlaps[a].add(b)
                overlaps[b].add(a)
    return {i: replace(lane, conflicts=tuple(sorted(overlaps.get(i, ())))) for i, lane in lanes.items()}


def _follow_or_neighbour(a: Lane, b: Lane) -> bool:
    beside = (a.adjacent_left, a.adjacent_right, a.reverse_of)
    return a.lane_id == b.reverse_of or b.lane_id in (*beside, *a.successors, *a.predecessors)


def _on_one_level(a: FloatArray, b: FloatArray, shared: shapely.Geometry) -> bool:
    if a.shape[1] < 3 or b.shape[1] < 3 or shared.is_empty:
        return True
    place = np.array(shared.centroid.coords[0])
    levels = [line[np.argmin(np.hypot(*(line[:, :2] - place).T)), 2] for line in (a, b)]
    return abs(float(levels[0] - levels[1])) < MIN_HEADROOM_M
