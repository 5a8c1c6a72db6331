"""Outlines of a net beside those of its map: widths, lengths, overhangs, lanes that stand for nothing."""

from __future__ import annotations

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import length_of, samples
from scex_sumo.lanelet2sumo.judge.matching import SAMPLE_M, Matching
from scex_sumo.lanelet2sumo.reader import NetContent, SumoLane
from scex_sumo.road import Lane

STUB_M = 2.05  # a border lanelet inside an intersection gets an approach of at most this, rounding included
LENGTH_TOLERANCE_M = 0.25  # SUMO rounds shapes to centimetres, and lanes up to its shortest length of 0.1 m
REVERSED_M = 0.5  # of a lanelet, for a direction


class Outlines:
    """Widths and lengths of all lanelets, sampled every 0.5 m.

    Attributes:
        overhangs: (SUMO lane, m that it runs on beyond its lanelets).
        width_errors: (N,) m; ``width_floor`` (N,) is that of lanes with the median width.
        wrong_lengths: edges whose written length is not the mean of their lanes' (edge, written, mean).
        reversed: (lanelet, SUMO lane) of opposite directions.
        invented: SUMO's lanes for cars that stand for no lanelet of the road.
        opened: lanelets closed to cars whose SUMO lanes are open to them.
    """

    def __init__(self, matching: Matching) -> None:
        net, lanes, vehicle = matching.net, matching.road.lanes, matching.road.vehicle_lanes
        present = [i for i in vehicle if any(net.lanes[name].cars for name in matching.names(i))]
        overhangs = {
            name: _overhang_m(net.lanes[name], [lanes[i] for i in under])
            for name in matching.by_sumo_lane
            if name in net.car_lanes and (under := matching.lanelets(name)) & vehicle.keys()
        }
        self.overhang_max_m = max(overhangs.values(), default=0.0)
        self.overhangs = sorted((name, m) for name, m in overhangs.items() if m > STUB_M)
        self.wrong_lengths, self.reversed = _wrong_lengths(net), _reversed(matching)
        unknown = [n for n in net.car_lanes if not matching.lanelets(n) & vehicle.keys()]
        self.invented = sorted(n for n in unknown if net.lanes[n].line.length > STUB_M)
        self.opened = sorted({i for name in unknown for i in matching.lanelets(name)})
        widths = [_widths(matching, lanes[i]) for i in present] or [(np.zeros(1), np.zeros(1))]
        self.width_errors, self.width_floor = map(np.concatenate, zip(*widths, strict=True))


def _overhang_m(sumo_lane: SumoLane, lanelets: list[Lane]) -> float:
    points = shapely.points(samples(sumo_lane.shape, SAMPLE_M)[1])
    lines = [shapely.LineString(lane.centreline) for lane in lanelets]
    off = np.min([shapely.distance(points, line) for line in lines], axis=0)
    at = [(shapely.line_locate_point(line, points), line.length) for line in lines]
    beside = np.any([(s > 0.0) & (s < length) for s, length in at], axis=0)
    return float(off[~beside].max(initial=0.0))


def _widths(matching: Matching, lane: Lane) -> tuple[FloatArray, FloatArray]:
    line, sampled = shapely.LineString(lane.centreline), shapely.points(samples(lane.centreline, SAMPLE_M)[1])
    bounds = (shapely.LineString(bound) for bound in (lane.left_bound, lane.right_bound))
    width = sum(shapely.distance(sampled, bound) for bound in bounds)
    at = np.linspace(0.0, line.length, len(sampled))
    errors = [np.empty(0)]
    for stretch in matching.by_lanelet[lane.lane_id]:
        if (sumo_lane := matching.net.lanes[stretch.sumo_lane]).cars:
            ends = (sumo_lane.line.interpolate(s) for s in (stretch.start_m, stretch.end_m))
            low, high = sorted(map(line.project, ends))
            beside = (at >= low - 1e-6) & (at <= high + 1e-6)
            errors.append(np.abs(width[beside] - sumo_lane.width_m))
    return np.concatenate(errors), np.abs(width - np.median(width))


def _wrong_lengths(net: NetContent) -> list[tuple[str, float, float]]:
    wrong = []
    for edge, names in net.edges.items():
        lanes = [net.lanes[name] for name in names]
        drawn = float(np.mean([lane.line.length for lane in lanes]))
        written = lanes[0].length_m  # SUMO gives all lanes of an edge one length
        if any(lane.cars for lane in lanes) and abs(written - drawn) > LENGTH_TOLERANCE_M:
            wrong.append((edge, written, drawn))
    return sorted(wrong)


def _reversed(matching: Matching) -> list[tuple[int, str]]:
    reversed_parts = []
    for lane_id, stretches in matching.by_lanelet.items():
        least = -min(REVERSED_M, 0.5 * length_of(matching.road.lanes[lane_id].centreline))
        reversed_parts += [(lane_id, s.sumo_lane) for s in stretches if s.end_m - s.start_m < least]
    return sorted(reversed_parts)
