"""Lane changes within intersections: the map permits them, but no edge has room there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely

from scex_sumo.arrays import BoolArray
from scex_sumo.converters.fidelity.conflicts import NEAR_M, near_runs
from scex_sumo.road import Lane

ROOM_M = 7.5  # a car and its gap: SUMO changes lanes on edges alone, and an edge must not lie in a crossing
FRACTIONS = 201  # where lanes side by side are looked at


def changes_inside(lanes: Mapping[int, Lane]) -> set[tuple[int, int]]:
    """Permitted changes between lanelets that other traffic crosses or joins along their whole length.

    Side by side in a SUMO edge lie all lanelets that cars may change between. Where no stretch of them as
    long as a car is clear of other lanelets, an edge would hide a conflict.
    """
    found: set[tuple[int, int]] = set()
    for group in _groups(lanes):
        free = np.logical_and.reduce([_free(lanes, i, group) for i in group])
        longest = max((end - start + 1 for start, end in near_runs(free)), default=0)
        length = float(np.mean([shapely.LineString(lanes[i].centreline).length for i in group]))
        if longest / FRACTIONS * length < ROOM_M:
            found |= {(i, j) for i in group for j in (lanes[i].left, lanes[i].right) if j in group}
    return found


def _groups(lanes: Mapping[int, Lane]) -> list[set[int]]:
    """Lanelets that changes connect, those with others alone."""
    groups: list[set[int]] = []
    for i, lane in lanes.items():
        own = {i} | {j for j in (lane.left, lane.right) if j is not None and j in lanes}
        if len(own) > 1:
            joined = [group for group in groups if group & own]
            groups = [group for group in groups if not group & own] + [own.union(*joined)]
    return groups


def _free(lanes: Mapping[int, Lane], lane_id: int, group: set[int]) -> BoolArray:
    """(FRACTIONS,) where no conflicting lanelet outside the group comes near."""
    line = shapely.LineString(lanes[lane_id].centreline)
    points = shapely.line_interpolate_point(line, np.linspace(0.0, 1.0, FRACTIONS), normalized=True)
    others = [i for i in lanes[lane_id].conflicts if i in lanes and i not in group]
    if not others:
        return np.ones(FRACTIONS, dtype=np.bool_)
    lines = shapely.MultiLineString([lanes[i].centreline for i in others])
    return np.asarray(shapely.distance(points, lines) > NEAR_M)
