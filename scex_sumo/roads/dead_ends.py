"""Dead ends inside a map: lanes that end or begin shortly before another lane of their direction."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import shapely

from scex_sumo.geometry.polylines import along, heading, wrap
from scex_sumo.road import Lane

DEAD_ENDS = "lanes that end or begin inside the map, where one may be missing"
REACH_M, SPREAD_RAD = 20.0, math.radians(30.0)  # a sector ahead of the end
ALIGNED_RAD = math.radians(60.0)
STEP_M = 0.5  # over which a lane's direction is taken


def dead_ends(lanes: Mapping[int, Lane]) -> list[int]:
    """Return the vehicle lanes without successor (predecessor) that have another lane ahead (behind).

    Lanes beside others may end there.
    """
    cars = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    ends = [
        (lane, at_end)
        for lane in cars.values()
        for at_end in (True, False)
        if not (lane.successors if at_end else lane.predecessors) and cars.keys().isdisjoint(lane.beside)
    ]
    lines = {i: shapely.LineString(lane.centreline) for i, lane in cars.items()} if ends else {}
    ids, tree = list(lines), shapely.STRtree(list(lines.values()))
    found = []
    for lane, at_end in ends:
        sector, direction = _sector(lane, at_end=at_end)
        near = [ids[k] for k in tree.query(sector, predicate="intersects").tolist()]
        tip = shapely.Point(lane.centreline[-1 if at_end else 0])
        for i in near:
            if lane.lane_id in (i, cars[i].reverse_of) or lane.reverse_of == i:
                continue
            s = lines[i].project(shapely.Point(shapely.shortest_line(lines[i] & sector, tip).coords[0]))
            a, b = along(lanes[i].centreline, np.array([max(s - STEP_M, 0.0), s + STEP_M]))
            if abs(float(wrap(math.atan2(b[1] - a[1], b[0] - a[0]) - direction))) < ALIGNED_RAD:
                found.append(lane.lane_id)
                break
    return sorted(set(found))


def _sector(lane: Lane, *, at_end: bool) -> tuple[shapely.Polygon, float]:
    direction = heading(lane.centreline, end=at_end, reach=2.0)
    ahead = np.array([math.cos(direction), math.sin(direction)]) * (1.0 if at_end else -1.0)
    aside = np.array([-ahead[1], ahead[0]])
    tip, far = lane.centreline[-1 if at_end else 0], 1.0 + REACH_M * math.tan(SPREAD_RAD)
    corners = [tip + ahead + aside, tip + ahead - aside]
    corners += [tip + REACH_M * ahead + side * far * aside for side in (-1, 1)]
    return shapely.Polygon(corners), direction
