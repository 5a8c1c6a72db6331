"""Geometry figures of a net: lanes, deviation, widths, speed limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.reader import NetContent, SumoLane
from scex_sumo.judge.matching import COVERED, Matching, Stretch, sample_line
from scex_sumo.road import Lane

PRESENT_M = 1.0  # from a lanelet to SUMO lanes that stand for it
WORST_M = 0.1  # deviations from here on are named
STUB_M = 2.0  # a border lanelet inside an intersection gets an approach of at most this
SPEED_TOLERANCE_MPS = 0.01  # nets are written with two or three decimals
LENGTH_TOLERANCE_M = 0.25  # SUMO rounds shapes to centimetres, and lanes up to its shortest length of 0.1 m
REVERSED_M = 0.5  # of a lanelet, for a direction

Lanes = Mapping[int, list[SumoLane]]


def judge_geometry(matching: Matching) -> dict[str, Any]:
    """Compare shapes, widths and speeds lanelet by lanelet, sampled every 0.5 m."""
    net, road = matching.net, matching.road
    vehicle = road.vehicle_lanes
    own = {i: [net.lanes[name] for name in matching.names(i)] for i in vehicle}
    present = {i: cars for i, lanes in own.items() if (cars := [lane for lane in lanes if lane.cars])}
    forth = {i: _distances(road.lanes[i].centreline, lanes) for i, lanes in present.items()}
    covered = {i for i, off in forth.items() if np.mean(off <= PRESENT_M) >= COVERED}
    back, overhang = _back(matching)
    pooled = np.concatenate([*forth.values(), *back.values()]) if forth else np.array([np.nan])
    worst = {i: float(off.max()) for i, off in forth.items()}
    for name, off in back.items():
        for i in matching.lanelets(name):
            worst[i] = max(worst.get(i, 0.0), float(off.max(initial=0.0)))
    far = sorted(((i, m) for i, m in worst.items() if m > WORST_M), key=lambda entry: -entry[1])
    wrong_speeds = [entry for i in sorted(covered) for entry in _wrong_speed(matching, i, present[i])]
    error, floor = _widths(matching, present)
    return {
        "lanelets": len(vehicle),
        "lanes_present": len(covered),
        "missing_lanes": tuple(sorted(set(vehicle) - covered)),
        "speeds_right": len(covered) - len(wrong_speeds),
        "wrong_speeds": tuple(wrong_speeds),
        "deviation_p50_m": float(np.percentile(pooled, 50)),
        "deviation_p95_m": float(np.percentile(pooled, 95)),
        "deviation_max_m": float(pooled.max()),
        "worst_deviations": tuple(far),
        "overhang_max_m": max(overhang.values(), default=0.0),
        "overhangs": tuple(sorted((name, m) for name, m in overhang.items() if m > STUB_M + 0.05)),
        "wrong_lengths": _wrong_lengths(net),
        "reversed_lanes": _reversed(matching),
        "invented_lanes": tuple(
            sorted(name for name, lane in net.car_lanes.items() if _invented(matching, lane))
        ),
        "non_vehicle_as_cars": _non_vehicle_as_cars(matching),
        "width_error_mean_m": float(error.mean()),
        "width_error_max_m": float(error.max()),
        "width_error_floor_m": float(floor.mean()),
    }


def _distances(points: FloatArray, lanes: list[SumoLane]) -> FloatArray:
    union = shapely.MultiLineString([lane.shape for lane in lanes])
    return np.asarray(shapely.distance(shapely.points(sample_line(points)), union), dtype=np.float64)


def _back(matching: Matching) -> tuple[dict[str, FloatArray], dict[str, float]]:
    back, overhang = {}, {}
    for name in matching.by_sumo_lane:
        lanelets = [matching.road.lanes[i] for i in matching.lanelets(name)]
        if name not in matching.net.car_lanes or not any(lane.kind == "vehicle" for lane in lanelets):
            continue
        points = shapely.points(sample_line(matching.net.lanes[name].shape))
        off = np.full(len(points), np.inf)
        beside = np.zeros(len(points), dtype=np.bool_)
        for lane in lanelets:
            line = shapely.LineString(lane.centreline)
            at = shapely.line_locate_point(line, points)
            off = np.minimum(off, shapely.distance(points, line))
            beside |= (at > 0.0) & (at < line.length)
        back[name] = off[beside]
        overhang[name] = float(off[~beside].max(initial=0.0))
    return back, overhang


def _wrong_speed(matching: Matching, lane_id: int, lanes: list[SumoLane]) -> list[tuple[int, float, float]]:
    vehicle = matching.road.vehicle_lanes
    for lane in lanes:
        # One SUMO lane across several lanelets can have the limit of one of them only.
        limits = [vehicle[i].speed_limit_mps for i in matching.lanelets(lane.lane_id) if i in vehicle]
        if min(abs(lane.speed_mps - limit) for limit in limits) > SPEED_TOLERANCE_MPS:
            return [(lane_id, vehicle[lane_id].speed_limit_mps, lane.speed_mps)]
    return []


def _widths(matching: Matching, present: Lanes) -> tuple[FloatArray, FloatArray]:
    errors, floors = [], []
    for lane_id in present:
        lane = matching.road.lanes[lane_id]
        points = shapely.points(sample_line(lane.centreline))
        left, right = (
            shapely.distance(points, shapely.LineString(b)) for b in (lane.left_bound, lane.right_bound)
        )
        width = left + right
        at = np.linspace(0.0, shapely.LineString(lane.centreline).length, len(points))
        for stretch in matching.by_lanelet[lane_id]:
            if (sumo_lane := matching.net.lanes[stretch.sumo_lane]).cars:
                low, high = _covered(lane, sumo_lane, stretch)
                beside = (at >= low - 1e-6) & (at <= high + 1e-6)
                errors.append(np.abs(width[beside] - sumo_lane.width_m))
        floors.append(np.abs(width - np.median(width)))
    none = [np.zeros(1)]
    return np.concatenate(errors or none), np.concatenate(floors or none)


def _covered(lane: Lane, sumo_lane: SumoLane, stretch: Stretch) -> tuple[float, float]:
    line = shapely.LineString(lane.centreline)
    ends = sorted(line.project(sumo_lane.line.interpolate(s)) for s in (stretch.start_m, stretch.end_m))
    return float(ends[0]), float(ends[1])


def _wrong_lengths(net: NetContent) -> tuple[tuple[str, float, float], ...]:
    found = []
    for edge, names in net.edges.items():
        lanes = [net.lanes[name] for name in names]
        drawn = float(np.mean([lane.line.length for lane in lanes]))
        written = lanes[0].length_m  # SUMO gives all lanes of an edge one length
        if any(lane.cars for lane in lanes) and abs(written - drawn) > LENGTH_TOLERANCE_M:
            found.append((edge, written, drawn))
    return tuple(sorted(found))


def _reversed(matching: Matching) -> tuple[tuple[int, str], ...]:
    found = []
    for lane_id, stretches in matching.by_lanelet.items():
        length = float(shapely.LineString(matching.road.lanes[lane_id].centreline).length)
        least = -min(REVERSED_M, 0.5 * length)
        found += [(lane_id, s.sumo_lane) for s in stretches if s.end_m - s.start_m < least]
    return tuple(sorted(found))


def _invented(matching: Matching, lane: SumoLane) -> bool:
    known = matching.lanelets(lane.lane_id) & matching.road.vehicle_lanes.keys()
    return not known and bool(lane.line.length > STUB_M + 0.05)


def _non_vehicle_as_cars(matching: Matching) -> tuple[int, ...]:
    vehicle = matching.road.vehicle_lanes.keys()
    own = {
        i: [n for n in matching.names(i) if not matching.lanelets(n) & vehicle] for i in matching.road.lanes
    }
    return tuple(sorted(i for i, names in own.items() if any(matching.net.lanes[n].cars for n in names)))
