"""Side of the road on which traffic drives, from where its oncoming lanes lie."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, length_of, wrap
from scex_sumo.road import Lane

REACH_M = 25.0  # across both carriageways
ONCOMING_RAD = math.radians(165.0)
SURE = 0.8  # share of the length of lanes with oncoming ones
STEP_M = 10.0  # between places on lanes
UNKNOWN = "the side of the road is not known: traffic is taken to drive on the right"


def drives_on_left(lanes: Mapping[int, Lane]) -> bool | None:
    """Return whether the nearest oncoming lanes are on the right; None without any, or on both sides."""
    cars = [lane for lane in lanes.values() if lane.kind == "vehicle"]
    rows = np.concatenate([np.empty((0, 3)), *map(_poses, cars)])
    tree = shapely.STRtree(shapely.points(rows[:, :2]))
    one, other = tree.query(shapely.points(rows[:, :2]), predicate="dwithin", distance=REACH_M)
    step, heading = rows[other, :2] - rows[one, :2], rows[one, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    ahead, aside = step[:, 0] * cos + step[:, 1] * sin, step[:, 1] * cos - step[:, 0] * sin
    oncoming = np.abs(wrap(rows[other, 2] - heading)) > ONCOMING_RAD
    oncoming &= (np.abs(ahead) < STEP_M) & (np.abs(aside) > 1.0)
    nearest = np.full(len(rows), np.inf)
    np.minimum.at(nearest, one[oncoming], np.abs(aside[oncoming]))
    chosen = oncoming & (np.abs(aside) <= nearest[one])
    left, right = np.unique(one[chosen & (aside > 0)]).size, np.unique(one[chosen & (aside < 0)]).size
    if max(left, right) < SURE * (left + right) or left == right:
        return None
    return right > left


def _poses(lane: Lane) -> FloatArray:
    """Return (n, 3) places and headings along a lane, in its middle and each `STEP_M` from there."""
    length = length_of(lane.centreline)
    s = length / 2 + STEP_M * np.arange(-(length // 2 // STEP_M), length // 2 // STEP_M + 1)
    before, after = (along(lane.centreline, np.clip(s + d, 0.0, length)) for d in (-0.5, 0.5))
    return np.column_stack([(before + after) / 2, np.arctan2(*(after - before).T[::-1])])


def side_of(lanes: Mapping[int, Lane], *told: bool | None) -> tuple[bool, tuple[str, ...]]:
    """Return whether traffic drives on the left: by the lanes, else by what is told first, else not.

    The notes are about a side that is not known but matters.
    """
    known = [side for side in (drives_on_left(lanes), *told) if side is not None]
    matters = any(lane.conflicts or lane.left or lane.right for lane in lanes.values())
    return (known or [False])[0], (UNKNOWN,) if matters and not known else ()
