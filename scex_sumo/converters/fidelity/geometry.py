"""How well a net lies where its map does: lanes, deviation, widths, speed limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.fidelity.matching import COVERED, Matching, sample
from scex_sumo.converters.fidelity.net import Net, NetLane
from scex_sumo.road import Lane, Road

PRESENT_M = (
    1.0  # a lanelet is there when SUMO lanes pass this near; how near exactly is the deviation's affair
)
STUB_M = 2.0  # a border lanelet inside an intersection gets an approach of at most this
SPEED_TOLERANCE_MPS = 0.01  # nets are written with two or three decimals
LENGTH_TOLERANCE_M = 0.25  # SUMO rounds shapes to centimetres, and lanes up to its shortest length of 0.1 m
REVERSED_M = 0.5  # lanelets much shorter than a step have no direction worth arguing about


@dataclass(frozen=True, kw_only=True)
class GeometryFigures:
    """Where the net lies against its map.

    Attributes:
        lanelets: vehicle lanelets of the map.
        lanes_present: those that car lanes of SUMO cover.
        missing_lanes: ids of the others.
        speeds_right: of the present ones, those whose SUMO lanes have its limit.
        wrong_speeds: (lanelet, m/s in the map, m/s in SUMO).
        deviation_p50_m: lanelet centreline to SUMO lane and back, sampled every 0.5 m, median.
        deviation_p95_m: 95th percentile.
        deviation_max_m: greatest.
        worst_deviations: (lanelet, m), the worst first, above 0.1 m.
        overhang_max_m: how far a SUMO lane runs on beyond the ends of its lanelets.
        overhangs: (SUMO lane, m) of more than a stub.
        wrong_lengths: (SUMO edge, its length in m, its lanes' mean): SUMO's drivers go by the length, so
            their cars stand elsewhere than they think.
        reversed_lanes: (lanelet, SUMO lane) that run against each other.
        invented_lanes: car lanes of more than a stub that stand for no lanelet.
        non_vehicle_as_cars: lanelets closed to cars whose own SUMO lane is open to them.
        width_error_mean_m: SUMO width against the lanelet's width, sampled every 0.5 m.
        width_error_max_m: greatest.
        width_error_floor_m: the mean that the best constant width of each lanelet would leave.
    """

    lanelets: int
    lanes_present: int
    missing_lanes: tuple[int, ...]
    speeds_right: int
    wrong_speeds: tuple[tuple[int, float, float], ...]
    deviation_p50_m: float
    deviation_p95_m: float
    deviation_max_m: float
    worst_deviations: tuple[tuple[int, float], ...]
    overhang_max_m: float
    overhangs: tuple[tuple[str, float], ...]
    wrong_lengths: tuple[tuple[str, float, float], ...]
    reversed_lanes: tuple[tuple[int, str], ...]
    invented_lanes: tuple[str, ...]
    non_vehicle_as_cars: tuple[int, ...]
    width_error_mean_m: float
    width_error_max_m: float
    width_error_floor_m: float


def judge_geometry(net: Net, road: Road, matching: Matching) -> GeometryFigures:
    """Compare shapes, widths and speeds lanelet by lanelet."""
    present = {i: lanes for i, lane in road.vehicle_lanes.items() if (lanes := _car_lanes(net, matching, i))}
    forth = {
        i: _distances(road.lanes[i].centreline, [lane.shape for lane in lanes])
        for i, lanes in present.items()
    }
    covered = {i for i, off in forth.items() if np.mean(off <= PRESENT_M) >= COVERED}
    back, overhang = _back(net, road, matching)
    pooled = np.concatenate([*forth.values(), *back.values()]) if forth else np.array([np.nan])
    worst = {i: float(off.max()) for i, off in forth.items()}
    for name, off in back.items():
        for stretch in matching.by_sumo_lane[name]:
            worst[stretch.lane_id] = max(worst.get(stretch.lane_id, 0.0), float(off.max(initial=0.0)))
    wrong = [
        entry for i in sorted(covered) if (entry := _wrong_speed(road, matching, road.lanes[i], present[i]))
    ]
    error, floor = _widths(road, present)
    return GeometryFigures(
        lanelets=len(road.vehicle_lanes),
        lanes_present=len(covered),
        missing_lanes=tuple(sorted(set(road.vehicle_lanes) - covered)),
        speeds_right=len(covered) - len(wrong),
        wrong_speeds=tuple(wrong),
        deviation_p50_m=float(np.percentile(pooled, 50)),
        deviation_p95_m=float(np.percentile(pooled, 95)),
        deviation_max_m=float(pooled.max()),
        worst_deviations=tuple(
            sorted(((i, m) for i, m in worst.items() if m > 0.1), key=lambda entry: -entry[1])
        ),
        overhang_max_m=max(overhang.values(), default=0.0),
        overhangs=tuple(sorted((name, m) for name, m in overhang.items() if m > STUB_M + 0.05)),
        wrong_lengths=_wrong_lengths(net),
        reversed_lanes=_reversed(road, matching),
        invented_lanes=_invented(net, road, matching),
        non_vehicle_as_cars=_non_vehicle_as_cars(net, road, matching),
        width_error_mean_m=float(error.mean()),
        width_error_max_m=float(error.max()),
        width_error_floor_m=float(floor.mean()),
    )


def _car_lanes(net: Net, matching: Matching, lane_id: int) -> list[NetLane]:
    lanes = [net.lanes[stretch.sumo_lane] for stretch in matching.by_lanelet.get(lane_id, ())]
    return [lane for lane in lanes if lane.cars]


def _distances(points: FloatArray, lines: list[FloatArray]) -> FloatArray:
    union = shapely.MultiLineString(lines)
    return np.asarray(shapely.distance(shapely.points(sample(points)), union), dtype=np.float64)


def _back(net: Net, road: Road, matching: Matching) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Distance of each SUMO lane's points to its lanelets, and how far the lane runs on beyond them."""
    back, overhang = {}, {}
    for name, stretches in matching.by_sumo_lane.items():
        lanelets = [road.lanes[stretch.lane_id] for stretch in stretches]
        if not net.lanes[name].cars or not any(lane.kind == "vehicle" for lane in lanelets):
            continue
        points = shapely.points(sample(net.lanes[name].shape))
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


def _wrong_speed(
    road: Road, matching: Matching, lane: Lane, lanes: list[NetLane]
) -> tuple[int, float, float] | None:
    for sumo_lane in lanes:
        covered = (road.lanes[stretch.lane_id] for stretch in matching.by_sumo_lane[sumo_lane.lane_id])
        # One SUMO lane across several lanelets can have the limit of one of them only.
        limits = [other.speed_limit_mps for other in covered if other.kind == "vehicle"]
        if min(abs(sumo_lane.speed_mps - limit) for limit in limits) > SPEED_TOLERANCE_MPS:
            return lane.lane_id, lane.speed_limit_mps, sumo_lane.speed_mps
    return None


def _widths(road: Road, present: dict[int, list[NetLane]]) -> tuple[FloatArray, FloatArray]:
    errors, floors = [np.zeros(1)], [np.zeros(1)]
    for lane_id, lanes in present.items():
        lane = road.lanes[lane_id]
        points = shapely.points(sample(lane.centreline))
        bounds = (shapely.LineString(lane.left_bound), shapely.LineString(lane.right_bound))
        width = shapely.distance(points, bounds[0]) + shapely.distance(points, bounds[1])
        errors += [np.abs(width - sumo_lane.width_m) for sumo_lane in lanes]
        floors.append(np.abs(width - np.median(width)))
    skip = 1 if len(errors) > 1 else 0
    return np.concatenate(errors[skip:]), np.concatenate(floors[skip:])


def _wrong_lengths(net: Net) -> tuple[tuple[str, float, float], ...]:
    found = []
    for edge, names in net.edges.items():
        lanes = [net.lanes[name] for name in names]
        drawn = float(np.mean([shapely.LineString(lane.shape).length for lane in lanes]))
        written = lanes[0].length_m  # SUMO gives all lanes of an edge one length
        if any(lane.cars for lane in lanes) and abs(written - drawn) > LENGTH_TOLERANCE_M:
            found.append((edge, written, drawn))
    return tuple(sorted(found))


def _reversed(road: Road, matching: Matching) -> tuple[tuple[int, str], ...]:
    def against(stretch_length: float, lane: Lane) -> bool:
        return stretch_length < -min(REVERSED_M, 0.5 * float(shapely.LineString(lane.centreline).length))

    pairs = (s for s in matching.pairs if against(s.end_m - s.start_m, road.lanes[s.lane_id]))
    return tuple(sorted((s.lane_id, s.sumo_lane) for s in pairs))


def _invented(net: Net, road: Road, matching: Matching) -> tuple[str, ...]:
    vehicle = road.vehicle_lanes
    known = {
        n for n, stretches in matching.by_sumo_lane.items() if any(s.lane_id in vehicle for s in stretches)
    }
    unknown = {n: lane for n, lane in net.car_lanes.items() if n not in known}
    return tuple(
        sorted(n for n, lane in unknown.items() if shapely.LineString(lane.shape).length > STUB_M + 0.05)
    )


def _non_vehicle_as_cars(net: Net, road: Road, matching: Matching) -> tuple[int, ...]:
    """Closed lanelets with a car lane of their own, one that no vehicle lanelet shares."""
    closed = []
    for lane_id, lane in road.lanes.items():
        names = [stretch.sumo_lane for stretch in matching.by_lanelet.get(lane_id, ())]
        own = [n for n in names if not any(s.lane_id in road.vehicle_lanes for s in matching.by_sumo_lane[n])]
        if lane.kind != "vehicle" and any(net.lanes[n].cars for n in own):
            closed.append(lane_id)
    return tuple(sorted(closed))
