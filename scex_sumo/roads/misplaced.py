"""People where nobody walks: in buildings, behind a wall that they walk through, on motorways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import listed
from scex_sumo.road import Road
from scex_sumo.scene import States

CLOSED = ("building", "keepout")
WALLS = ("wall", "fence", "guard_rail", "building")
MOTORWAY_MPS = 99 / 3.6  # lanes with a higher limit
AHEAD_S = 3.0


def misplaced(road: Road | None, now: States, names: Sequence[object]) -> list[str]:
    """Return notes on people (P,) whose place or way contradicts the map."""
    if road is None or not len(names):
        return []
    travelled_m = AHEAD_S * now.speed
    there = np.stack(
        [now.x + travelled_m * np.cos(now.heading), now.y + travelled_m * np.sin(now.heading)], axis=1
    )
    points, ends = shapely.points(now.x, now.y), shapely.points(there)
    walls = [shapely.LineString(m.points) for m in road.markings if m.kind in WALLS and len(m.points) > 1]
    found = {
        "in buildings or closed areas": _within(points, [a.outline for a in road.areas if a.kind in CLOSED]),
        "on lanes of motorways": _within(points, _motorways(road)),
        "that walk through a wall or fence within 3 s": _meets(points, ends, walls),
    }
    return [
        f"people {what} (check map and tracks): {listed([names[k] for k in np.flatnonzero(where).tolist()])}"
        for what, where in found.items()
        if where.any()
    ]


def _motorways(road: Road) -> list[FloatArray]:
    return [
        lane.outline
        for lane in road.vehicle_lanes.values()
        if lane.speed_limit_mps > MOTORWAY_MPS or lane.subtype == "highway"
    ]


def _within(points: FloatArray, outlines: Sequence[FloatArray]) -> BoolArray:
    areas = [shapely.make_valid(shapely.Polygon(line)) for line in outlines if len(line) > 2]
    result = np.zeros(len(points), dtype=np.bool_)
    result[shapely.STRtree(areas).query(points, predicate="within")[0]] = True
    return result


def _meets(points: FloatArray, ends: FloatArray, walls: Sequence[shapely.LineString]) -> BoolArray:
    ways = shapely.linestrings(
        np.stack([shapely.get_coordinates(points), shapely.get_coordinates(ends)], axis=1)
    )
    result = np.zeros(len(points), dtype=np.bool_)
    result[shapely.STRtree(walls).query(ways, predicate="intersects")[0]] = True
    return result
