"""Side of the road on which traffic drives, from where its oncoming lanes lie; dead ends inside a map."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, heading, length_of, wrap
from scex_sumo.road import Lane

REACH_M = 25.0  # across both carriageways
ONCOMING_RAD = math.radians(165.0)
SURE = 0.8  # share of the length of lanes with oncoming ones
STEP_M = 10.0  # between places on lanes
UNKNOWN = "the side of the road is not known: traffic is taken to drive on the right"
DEAD_ENDS = "lanes that end or begin inside the map, where one may be missing"
AHEAD_M, SPREAD_RAD = 20.0, math.radians(30.0)  # a sector ahead of the end
ALIGNED_RAD = math.radians(60.0)
DIRECTION_M = 0.5  # over which a lane's direction is taken


def drives_on_left(lanes: Mapping[int, Lane]) -> bool | None:
    """Return whether the nearest oncoming lanes are on the right; None without any, or on both sides."""
    cars = [lane for lane in lanes.values() if lane.kind == "vehicle"]
    poses = np.concatenate([np.empty((0, 3)), *map(_poses, cars)])
    tree = shapely.STRtree(shapely.points(poses[:, :2]))
    pose, other = tree.query(shapely.points(poses[:, :2]), predicate="dwithin", distance=REACH_M)
    step, heading = poses[other, :2] - poses[pose, :2], poses[pose, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    ahead, aside = step[:, 0] * cos + step[:, 1] * sin, step[:, 1] * cos - step[:, 0] * sin
    oncoming = np.abs(wrap(poses[other, 2] - heading)) > ONCOMING_RAD
    oncoming &= (np.abs(ahead) < STEP_M) & (np.abs(aside) > 1.0)
    nearest = np.full(len(poses), np.inf)
    np.minimum.at(nearest, pose[oncoming], np.abs(aside[oncoming]))
    chosen = oncoming & (np.abs(aside) <= nearest[pose])
    left, right = np.unique(pose[chosen & (aside > 0)]).size, np.unique(pose[chosen & (aside < 0)]).size
    if max(left, right) < SURE * (left + right) or left == right:
        return None
    return right > left


def _poses(lane: Lane) -> FloatArray:
    """Return (n, 3) places and headings along a lane, in its middle and each `STEP_M` from there."""
    length = length_of(lane.centreline)
    s = length / 2 + STEP_M * np.arange(-(length // 2 // STEP_M), length // 2 // STEP_M + 1)
    before, after = (along(lane.centreline, np.clip(s + d, 0.0, length)) for d in (-0.5, 0.5))
    return np.column_stack([(before + after) / 2, np.arctan2(*(after - before).T[::-1])])


def side_of(lanes: Mapping[int, Lane], *drives_left: bool | None) -> tuple[bool, tuple[str, ...]]:
    """Return whether traffic drives on the left, by the lanes, else as told, else not; notes if unknown."""
    known = [side for side in (drives_on_left(lanes), *drives_left) if side is not None]
    matters = any(lane.conflicts or lane.left or lane.right for lane in lanes.values())
    return (known or [False])[0], (UNKNOWN,) if matters and not known else ()


def dead_ends(lanes: Mapping[int, Lane]) -> list[int]:
    """Return the vehicle lanes, none beside them, that end (begin) before (behind) another lane."""
    cars = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    ends = [
        (lane, at_end)
        for lane in cars.values()
        for at_end in (True, False)
        if not (lane.successors if at_end else lane.predecessors) and cars.keys().isdisjoint(lane.beside)
    ]
    lines = {i: shapely.LineString(lane.centreline) for i, lane in cars.items()} if ends else {}
    ids, tree = list(lines), shapely.STRtree(list(lines.values()))
    dead = []
    for lane, at_end in ends:
        sector, direction = _sector(lane, at_end=at_end)
        near = [ids[k] for k in tree.query(sector, predicate="intersects").tolist()]
        tip = shapely.Point(lane.centreline[-1 if at_end else 0])
        for i in near:
            if lane.lane_id in (i, cars[i].reverse_of) or lane.reverse_of == i:
                continue
            s = lines[i].project(shapely.Point(shapely.shortest_line(lines[i] & sector, tip).coords[0]))
            a, b = along(lanes[i].centreline, np.array([max(s - DIRECTION_M, 0.0), s + DIRECTION_M]))
            if abs(float(wrap(math.atan2(b[1] - a[1], b[0] - a[0]) - direction))) < ALIGNED_RAD:
                dead.append(lane.lane_id)
                break
    return sorted(set(dead))


def _sector(lane: Lane, *, at_end: bool) -> tuple[shapely.Polygon, float]:
    direction = heading(lane.centreline, end=at_end, reach=2.0)
    ahead = np.array([math.cos(direction), math.sin(direction)]) * (1.0 if at_end else -1.0)
    aside = np.array([-ahead[1], ahead[0]])
    tip, far = lane.centreline[-1 if at_end else 0], 1.0 + AHEAD_M * math.tan(SPREAD_RAD)
    corners = [tip + ahead + aside, tip + ahead - aside]
    corners += [tip + AHEAD_M * ahead + side * far * aside for side in (-1, 1)]
    return shapely.Polygon(corners), direction
