"""Lane table by geometry: the SUMO lanes of every lanelet, found without the converter's table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.geometry.polylines import samples, wrap
from scex_sumo.lanelet2sumo.judge.matching import COVERED, SAMPLE_M
from scex_sumo.road import Lane, Road
from tests.lanelet2sumo.judge.mirrored import read_mirrored

# From a lanelet to a SUMO lane; larger radii are for other converters' nets,
# and tried only for lanelets that the smaller ones leave uncovered.
RADII_M = (0.05, 0.3, 1.0, 2.0)
CONNECTOR_M = 0.25  # shorter SUMO lanes only join others; they lie on every lanelet that begins there
AHEAD_RAD = np.deg2rad(60.0)


def sample_headings(points: FloatArray) -> FloatArray:
    """(N,) rad, central differences along sampled points."""
    return np.asarray(np.arctan2(*np.gradient(points, axis=0).T[::-1]))


def lanes_by_geometry(net_path: Path, road: Road) -> LaneTable:
    """Find the SUMO lanes of every lanelet by geometry."""
    net, road = read_mirrored(net_path, road)
    names = [name for name, lane in net.lanes.items() if lane.line.length >= CONNECTOR_M]
    points = [samples(net.lanes[name].shape, SAMPLE_M)[1] for name in names]
    directions = [sample_headings(p) for p in points]
    boxes = shapely.STRtree([shapely.LineString(p) for p in points])
    pairs: list[tuple[int, str]] = []
    for lane_id, lane in road.lanes.items():
        near = boxes.query(shapely.LineString(lane.centreline).buffer(max(RADII_M)))
        usable = [k for k in sorted(near) if lane.kind != "vehicle" or net.lanes[names[k]].cars]
        for radius in RADII_M:
            chosen = [k for k in usable if _follows(lane, points[k], directions[k], radius)]
            if _covered(lane, [points[k] for k in chosen], radius):
                break
        pairs += [(lane_id, names[k]) for k in chosen]
    return LaneTable(tuple(pairs))


def _follows(lane: Lane, points: FloatArray, directions: FloatArray, radius: float) -> bool:
    line = shapely.LineString(lane.centreline)
    at = shapely.line_locate_point(line, shapely.points(points)) if line.length > 0.0 else np.zeros(1)
    beside = (at > 1e-6) & (at < line.length - 1e-6)
    if not beside.any():
        return False
    at = at[beside]
    off = shapely.distance(shapely.points(points[beside]), line)
    ahead, behind = (
        shapely.get_coordinates(shapely.line_interpolate_point(line, s))
        for s in (at + 0.1, np.maximum(at - 0.1, 0.0))
    )
    same_way = np.abs(wrap(np.arctan2(*(ahead - behind).T[::-1]) - directions[beside])) < AHEAD_RAD
    if np.mean((off <= radius) & same_way) < COVERED or off.max() > 2 * radius:
        return False
    # The end of a long lane may brush past the lanelet's first half metre: too little to stand for it.
    whole = min(line.length, shapely.LineString(points).length)
    return bool(np.ptp(at) >= min(1.0, 0.5 * whole))


def _covered(lane: Lane, lanes: list[FloatArray], radius: float) -> bool:
    lines = shapely.union_all([shapely.LineString(points) for points in lanes])
    near = shapely.distance(shapely.points(samples(lane.centreline, SAMPLE_M)[1]), lines) <= radius
    return bool(np.mean(near) >= COVERED)  # nothing is near no lines: their distance is nan
