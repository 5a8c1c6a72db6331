"""Matching of SUMO lanes to lanelets: from a lane table, or by geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.geometry.polylines import samples, wrap
from scex_sumo.lanelet2sumo.reader import NetContent
from scex_sumo.road import Lane, Road

SAMPLE_M = 0.5
# From a lanelet to a SUMO lane; larger radii are for other converters' nets,
# and tried only for lanelets that the smaller ones leave uncovered.
RADII_M = (0.05, 0.3, 1.0, 2.0)
ENDS_NEAR_M = 2.5  # from a lanelet's end to a SUMO lane beside it
CONNECTOR_M = 0.25  # shorter SUMO lanes only join others; they lie on every lanelet that begins there
COVERED = 0.9  # share of a lanelet's length from which it counts as covered
AHEAD_RAD = np.deg2rad(60.0)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Piece of a SUMO lane that stands for a lanelet; ``end_m`` ≤ ``start_m`` in the opposite direction."""

    lane_id: int
    sumo_lane: str
    start_m: float
    end_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Matching:
    """A net beside its map; stretches of SUMO lanes are in driving order."""

    net: NetContent
    road: Road
    by_lanelet: Mapping[int, Sequence[Stretch]]
    by_sumo_lane: Mapping[str, Sequence[Stretch]]

    def names(self, lane_id: int) -> list[str]:
        """Return the SUMO lanes of a lanelet."""
        return [stretch.sumo_lane for stretch in self.by_lanelet.get(lane_id, ())]

    def lanelets(self, sumo_lane: str) -> set[int]:
        """Return the lanelets that a SUMO lane stands for."""
        return {stretch.lane_id for stretch in self.by_sumo_lane.get(sumo_lane, ())}


def sample_line(points: FloatArray, step_m: float = SAMPLE_M) -> FloatArray:
    """(N, 2) points along a polyline, at most ``step_m`` apart, both ends included."""
    return samples(points, step_m)[1]


def sample_headings(points: FloatArray) -> FloatArray:
    """(N,) rad, central differences along sampled points."""
    return np.asarray(np.arctan2(*np.gradient(points, axis=0).T[::-1]))


def match_lanelets(net: NetContent, road: Road, lanes: LaneTable | None) -> Matching:
    """Find the SUMO lanes of every lanelet: from the converter's table or, without one, by geometry."""
    if lanes is None:
        named = _by_geometry(net, road)
    else:
        named = [(i, name) for i in road.lanes for name in lanes.sumo_lanes(i) if name in net.lanes]
    on = [_stretch(road.lanes[i], name, net.lanes[name].line) for i, name in named]
    by_lanelet: dict[int, list[Stretch]] = {}
    by_sumo_lane: dict[str, list[Stretch]] = {}
    for stretch in on:
        by_lanelet.setdefault(stretch.lane_id, []).append(stretch)
    for stretch in sorted(on, key=lambda s: (s.start_m, s.end_m)):
        by_sumo_lane.setdefault(stretch.sumo_lane, []).append(stretch)
    return Matching(net=net, road=road, by_lanelet=by_lanelet, by_sumo_lane=by_sumo_lane)


def _stretch(lane: Lane, sumo_lane: str, line: shapely.LineString) -> Stretch:
    start, end = 0.0, float(line.length)
    if line.length > 0.0:  # SUMO's shortest connectors may be one point
        ends = shapely.points(lane.centreline[[0, -1]])
        at = shapely.line_locate_point(line, ends)
        # Where an end of the lanelet is far away, the SUMO lane is a piece of it up to its own end.
        begins, stops = shapely.distance(line, ends) <= ENDS_NEAR_M
        start, end = float(at[0]) if begins else start, float(at[1]) if stops else end
    return Stretch(lane_id=lane.lane_id, sumo_lane=sumo_lane, start_m=start, end_m=end)


def _by_geometry(net: NetContent, road: Road) -> list[tuple[int, str]]:
    names = [name for name, lane in net.lanes.items() if lane.line.length >= CONNECTOR_M]
    points = [sample_line(net.lanes[name].shape) for name in names]
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
    return pairs


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
    near = shapely.distance(shapely.points(sample_line(lane.centreline)), lines) <= radius
    return bool(np.mean(near) >= COVERED)  # nothing is near no lines: their distance is nan
