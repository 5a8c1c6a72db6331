"""Room beside places on paths, to the bounds of the lane there."""

from __future__ import annotations

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.road import Road

CLEAR_M = 1.4  # of the line from the bounds of its lanes


@owner_cache
def lane_bounds(road: Road) -> dict[int, tuple[shapely.LineString, shapely.LineString]]:
    """Return the left and right bound of each lane."""
    return {
        number: (shapely.LineString(lane.left_bound), shapely.LineString(lane.right_bound))
        for number, lane in road.vehicle_lanes.items()
    }


@owner_cache
def lane_areas(road: Road) -> dict[int, shapely.Polygon]:
    """Return the area of each lane."""
    return {number: shapely.Polygon(lane.outline) for number, lane in road.vehicle_lanes.items()}


def room_at(road: Road, paths: SeedPaths, s: FloatArray) -> FloatArray:
    """Return (P, 2) distances from places on paths to the left and right bound of their lane, m.

    Of the lanes of a path that contain the place the narrowest counts; off the lanes the room is 0.

    ``s``: (P,) place on each path, m.
    """
    x, y = paths.at(np.arange(len(s)), s)[:2]
    row = np.repeat(np.arange(len(s)), [len(lanes) for lanes in paths.lanes])
    lanes = [lane for some in paths.lanes for lane in some]
    bounds, areas = lane_bounds(road), lane_areas(road)
    inside = shapely.contains_xy(np.array([areas[lane] for lane in lanes], dtype=object), x[row], y[row])
    row, sides = row[inside], [bounds[lane] for lane, there in zip(lanes, inside, strict=True) if there]
    far = shapely.distance(shapely.points(x, y)[row, None], np.array(sides, dtype=object).reshape(-1, 2))
    order = np.lexsort((far.sum(axis=1), row))
    path, narrowest = np.unique(row[order], return_index=True)
    room = np.zeros((len(s), 2))
    room[path] = far[order[narrowest]]
    return room
