"""Shapes of a net beside those of its map: deviation, widths, speed limits, lengths."""

from __future__ import annotations

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import length_of
from scex_sumo.lanelet2sumo.judge.matching import COVERED, Matching, sample_line
from scex_sumo.lanelet2sumo.reader import NetContent, SumoLane
from scex_sumo.road import Lane

PRESENT_M = 1.0  # from a lanelet to SUMO lanes that stand for it
WORST_M = 0.1  # deviations from here on are named
STUB_M = 2.05  # a border lanelet inside an intersection gets an approach of at most this, rounding included
SPEED_TOLERANCE_MPS = 0.01  # nets are written with two or three decimals
LENGTH_TOLERANCE_M = 0.25  # SUMO rounds shapes to centimetres, and lanes up to its shortest length of 0.1 m
REVERSED_M = 0.5  # of a lanelet, for a direction


class Shapes:
    """Distances and widths of all lanelets, sampled every 0.5 m.

    Attributes:
        lanelets: of the map, for vehicles; ``covered`` are those under SUMO lanes for cars.
        deviations: (N,) m, from lanelets to SUMO lanes and back.
        worst: (lanelet, largest deviation in m), the largest first.
        overhangs: (SUMO lane, m that it runs on beyond its lanelets).
        width_errors: (N,) m; ``width_floor`` (N,) is that of lanes with the median width.
        wrong_lengths: edges whose written length is not the mean of their lanes' (edge, written, mean).
        reversed: (lanelet, SUMO lane) of opposite directions.
        invented: SUMO's lanes for cars that stand for no lanelet of the road.
        opened: lanelets closed to cars whose SUMO lanes are open to them.
    """

    def __init__(self, matching: Matching) -> None:
        net, lanes = matching.net, matching.road.lanes
        self.lanelets = matching.road.vehicle_lanes
        on = {i: [net.lanes[n] for n in matching.names(i) if net.lanes[n].cars] for i in self.lanelets}
        present = {i: own for i, own in on.items() if own}
        forth = {i: _distances(lanes[i].centreline, own) for i, own in present.items()}
        self.covered = [i for i in sorted(forth) if np.mean(forth[i] <= PRESENT_M) >= COVERED]
        self.wrong_speeds = [
            entry for i in self.covered for entry in _wrong_speed(matching, i, present[i])[:1]
        ]
        worst = {i: float(off.max()) for i, off in forth.items()}
        pooled, overhangs = list(forth.values()), dict[str, float]()
        for name in matching.by_sumo_lane:
            under = matching.lanelets(name)
            if name in net.car_lanes and under & self.lanelets.keys():
                off, overhangs[name] = _back(net.lanes[name], [lanes[i] for i in under])
                pooled.append(off)
                for i in under:
                    worst[i] = max(worst.get(i, 0.0), float(off.max(initial=0.0)))
        self.overhang_max_m = max(overhangs.values(), default=0.0)
        self.overhangs = sorted((name, m) for name, m in overhangs.items() if m > STUB_M)
        self.deviations = np.concatenate(pooled) if forth else np.array([np.nan])
        self.worst = sorted(((i, m) for i, m in worst.items() if m > WORST_M), key=lambda entry: -entry[1])
        self.wrong_lengths, self.reversed = _wrong_lengths(net), _reversed(matching)
        unknown = [n for n in net.car_lanes if not matching.lanelets(n) & self.lanelets.keys()]
        self.invented = sorted(n for n in unknown if net.lanes[n].line.length > STUB_M)
        self.opened = sorted({i for name in unknown for i in matching.lanelets(name)})
        widths = [_widths(matching, lanes[i]) for i in present] or [(np.zeros(1), np.zeros(1))]
        self.width_errors, self.width_floor = map(np.concatenate, zip(*widths, strict=True))


def _distances(points: FloatArray, lanes: list[SumoLane]) -> FloatArray:
    union = shapely.MultiLineString([lane.shape for lane in lanes])
    return np.asarray(shapely.distance(shapely.points(sample_line(points)), union), dtype=np.float64)


def _back(sumo_lane: SumoLane, lanelets: list[Lane]) -> tuple[FloatArray, float]:
    points = shapely.points(sample_line(sumo_lane.shape))
    lines = [shapely.LineString(lane.centreline) for lane in lanelets]
    off = np.min([shapely.distance(points, line) for line in lines], axis=0)
    at = [(shapely.line_locate_point(line, points), line.length) for line in lines]
    beside = np.any([(s > 0.0) & (s < length) for s, length in at], axis=0)
    return off[beside], float(off[~beside].max(initial=0.0))


def _wrong_speed(matching: Matching, lane_id: int, lanes: list[SumoLane]) -> list[tuple[int, float, float]]:
    vehicle = matching.road.vehicle_lanes
    wrong = []
    for lane in lanes:
        # One SUMO lane across several lanelets can have the limit of one of them only.
        limits = [vehicle[i].speed_limit_mps for i in matching.lanelets(lane.lane_id) if i in vehicle]
        if min(abs(lane.speed_mps - limit) for limit in limits) > SPEED_TOLERANCE_MPS:
            wrong.append((lane_id, vehicle[lane_id].speed_limit_mps, lane.speed_mps))
    return wrong


def _widths(matching: Matching, lane: Lane) -> tuple[FloatArray, FloatArray]:
    line, sampled = shapely.LineString(lane.centreline), shapely.points(sample_line(lane.centreline))
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
