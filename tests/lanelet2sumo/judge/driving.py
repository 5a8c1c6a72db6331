"""Driving test of a net: SUMO's own vehicles arrive without overlap or teleport."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import shapely
from scipy.spatial import cKDTree

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.geometry.polylines import cut, heading, length_of, turn
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.lanelet2sumo.judge.report import FidelityReport, Figure, Figures, measured
from scex_sumo.lanelet2sumo.reader import NetContent, SumoLane, read_net
from scex_sumo.road import Road
from tests.lanelet2sumo.judge.report import check_net
from tests.lanelet2sumo.judge.topology import car_links

RUN_UP_M = 20.0  # braking distance at 50 km/h
STEP_S = 0.1
LOOK_S = 0.2  # footprints are compared this often
WAIT_S = 300.0  # SUMO's own: a vehicle that stands longer is teleported
SHRINK_M = 0.02  # so much may boxes overlap
DRAIN_S = 900.0  # for the last vehicles to arrive, a deadlock included
LIMIT_S = 300.0  # wall clock
COUNTED = ("collision", "eleport", "emergency braking", "Suspicious right_before_left junction")
NET = "driven.net.xml"
SEED = 0  # of the order of departures and of SUMO's own randomness
LENGTH_M = 4.7  # of a car
WIDTH_M = 1.8
HEAD_ON_RAD = np.deg2rad(150.0)
CHANGE_M = 10.0  # shorter edges have no room for two cars to swap lanes

Overlap: TypeAlias = tuple[str, str, str, str, float]


class Driving:
    """What happens to SUMO's cars on all routes from the net's borders to its borders.

    Attributes:
        routes: number of routes driven, in turn and in a random order.
        warnings: what SUMO says on its error stream, without what the other figures count.
        overlaps: (vehicle, lane, vehicle, lane, time in s) of each pair's first overlap.
        arrived: number of vehicles at the ends of their routes.
    """

    def __init__(self, net_path: Path, *, vehicles: int, headway_s: float) -> None:
        net = read_net(net_path)
        routes = border_routes(net)
        assert routes, f"{net_path}: no route from border to border for cars"
        order = np.random.default_rng(SEED).permutation(np.arange(vehicles) % len(routes))
        self.vehicles, self.routes = vehicles, len(set(order.tolist()))
        with TemporaryDirectory() as name:
            folder = Path(name)
            demand = _demand(net, [routes[k] for k in order], headway_s)
            (folder / "demand.rou.xml").write_text(demand, encoding="utf-8")
            (folder / NET).symlink_to(net_path.resolve())
            said = _simulate(net_path, folder, vehicles * headway_s + DRAIN_S)
            self.overlaps = _overlaps(folder / "fcd.parquet")
            counts = ElementTree.parse(folder / "statistics.xml").getroot()
            trips = ElementTree.parse(folder / "trips.xml").getroot().findall("tripinfo")
        self.warnings = [line for line in said if not any(word in line for word in COUNTED)]
        self.teleports, self.collisions = (
            int(counts.find(tag).get(key, "0"))  # type: ignore[union-attr]
            for tag, key in (("teleports", "total"), ("safety", "collisions"))
        )
        there = [trip for trip in trips if float(trip.get("arrival", -1.0)) >= 0.0]
        self.arrived = sum(not trip.get("vaporized") for trip in there)


def _demand(net: NetContent, routes: list[tuple[str, ...]], headway_s: float) -> str:
    """SUMO's routes file. Cars that start just before a crossing start from rest; on an edge shorter than a
    car they start at its beginning, because SUMO leaves no gap to a car before that has turned elsewhere.
    """
    size = f'length="{LENGTH_M}" width="{WIDTH_M}"'
    lines = [f'<routes><vType id="car" vClass="passenger" {size} sigma="0.5"/>']
    contested = {
        k.from_lane for k in car_links(net) if k.row >= 0 and net.junctions[k.junction].foes[k.row].any()
    }
    waiting = {net.lanes[name].edge_id for name in contested if net.lanes[name].length_m < RUN_UP_M}
    for number, edges in enumerate(routes):
        speed = "0" if edges[0] in waiting else "max"
        place = "0" if net.lanes[net.edges[edges[0]][0]].length_m < LENGTH_M else "base"
        lines.append(
            f'<vehicle id="v{number}" type="car" depart="{number * headway_s}" departLane="best"'
            f' departPos="{place}" departSpeed="{speed}"><route edges="{" ".join(edges)}"/></vehicle>'
        )
    return "\n".join([*lines, "</routes>"])


def _simulate(net_path: Path, folder: Path, end_s: float) -> tuple[str, ...]:
    options = (
        f"--net-file {NET} --route-files demand.rou.xml --end {end_s} --step-length {STEP_S} --seed {SEED}"
        f" --time-to-teleport {WAIT_S} --collision.action warn --collision.check-junctions true"
        f" --fcd-output fcd.parquet --fcd-output.attributes id,x,y,angle,lane --device.fcd.period {LOOK_S}"
        " --tripinfo-output trips.xml --statistic-output statistics.xml --xml-validation never --no-step-log"
    )
    size = net_path.stat().st_size
    lines = run_program("sumo", *options.split(), folder=folder, file_bytes=size, limit_s=LIMIT_S)
    errors = [line for line in lines if line.startswith("Error")]
    assert not errors, f"{net_path}: cars cannot drive on it: {errors[:3]}"
    return lines


def _overlaps(fcd: Path) -> list[Overlap]:
    cars = pq.read_table(fcd).drop_null()  # a step without cars has a row too
    time_s = cars["timestep_time"].to_numpy()
    poses = np.column_stack([cars[f"vehicle_{name}"].to_numpy() for name in ("x", "y", "angle")])
    names, lanes = (cars[f"vehicle_{name}"].to_pylist() for name in ("id", "lane"))
    reach = float(np.hypot(LENGTH_M, WIDTH_M))
    places = np.column_stack([poses[:, :2], 1e6 * time_s])  # only cars of one time are near each other
    first, second = np.sort(cKDTree(places).query_pairs(2 * reach, output_type="ndarray"), axis=1).T
    boxes = shapely.polygons(_corners(poses))
    touch = np.flatnonzero(shapely.intersects(boxes[first], boxes[second]))
    overlaps: dict[tuple[str, str], Overlap] = {}
    for k in touch[np.argsort(first[touch])].tolist():
        one, other = first[k], second[k]
        overlap = (names[one], lanes[one], names[other], lanes[other], float(time_s[one]))
        overlaps.setdefault((names[one], names[other]), overlap)
    return list(overlaps.values())


def _corners(poses: FloatArray) -> FloatArray:
    heading = np.deg2rad(90.0 - poses[:, 2])  # SUMO: 0 = north, clockwise
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[:, None]
    left = ahead[..., ::-1] * [-1.0, 1.0]
    along = np.array([-SHRINK_M, -SHRINK_M, SHRINK_M - LENGTH_M, SHRINK_M - LENGTH_M])[:, None]
    across = np.array([0.5, -0.5, -0.5, 0.5])[:, None] * (WIDTH_M - 2 * SHRINK_M)
    corners: FloatArray = poses[:, None, :2] + along * ahead + across * left
    return corners


def border_routes(net: NetContent) -> list[tuple[str, ...]]:
    """Return the shortest route in edges for every pair of border edges that lanes connect.

    Routes leave room for lane changes, if any does. Without borders they start and end anywhere. No route
    begins where a car would block others.
    """
    edges = {lane.edge_id for lane in net.car_lanes.values() if not lane.internal}
    entered = {net.lanes[link.to_lane].edge_id for link in car_links(net)}
    left = {net.lanes[link.from_lane].edge_id for link in car_links(net)}
    first, ends = edges - entered, edges - left
    starts = first - _in_the_way(net, first) or first or edges
    for room_m in (CHANGE_M, 0.0):
        moves = _lane_moves(net, room_m)
        routes = [
            path
            for start in sorted(starts)
            for end, path in sorted(_paths(net, moves, start).items())
            if end in (ends or edges) and (end != start or start in first & ends)
        ]
        if routes:
            break
    return routes


def _in_the_way(net: NetContent, starts: set[str]) -> set[str]:
    cars = {name: lane for name, lane in net.car_lanes.items() if length_of(lane.shape) > 0.0}
    apart = {name: {*net.edges[lane.edge_id]} for name, lane in cars.items() if lane.edge_id in starts}
    source: dict[str, str] = {}
    for link in car_links(net):
        if link.from_lane in apart:
            apart[link.from_lane] |= {*link.via, link.to_lane}
            source |= dict.fromkeys(link.via, link.from_lane)
    beside: dict[str, set[str]] = {name: set() for name in apart}
    for name, other in _too_near(cars, {i: _standing(cars[i].shape) for i in apart}, apart):
        passing = source.get(other, other)
        beside[name].add(passing)
        if passing in beside:
            beside[passing].add(name)
    allowed: set[str] = set()
    for name in sorted(apart, key=lambda name: (-cars[name].length_m, name)):
        if not beside[name] - (apart.keys() - allowed):
            allowed.add(name)
    return {cars[name].edge_id for name in apart.keys() - allowed}


def _too_near(
    cars: Mapping[str, SumoLane], standing: Mapping[str, FloatArray], apart: Mapping[str, Collection[str]]
) -> Iterator[tuple[str, str]]:
    names, order = list(cars), list(standing)
    driven = [np.vstack([*([standing[i][:1]] if i in standing else []), cars[i].shape]) for i in names]
    tree = shapely.STRtree([shapely.LineString(line) for line in driven])
    stands = [shapely.LineString(line) for line in standing.values()]
    near = tree.query(stands, predicate="dwithin", distance=WIDTH_M).T.tolist() if stands else ()
    for name, other in ((order[k], names[j]) for k, j in near):  # a closed circuit has no starts
        if other not in apart[name] and not _head_on(standing[name], cars[other].shape):
            yield name, other


def _standing(line: FloatArray) -> FloatArray:
    if length_of(line) >= LENGTH_M:
        return cut(line, 0.0, LENGTH_M)
    angle = heading(line, end=False)
    return np.vstack([line[0] - LENGTH_M * np.array([np.cos(angle), np.sin(angle)]), line])


def _head_on(standing: FloatArray, line: FloatArray) -> bool:
    at, to = shapely.LineString(line), shapely.LineString(standing)
    s = at.project(shapely.shortest_line(at, to).interpolate(0.0))
    near = cut(line, max(s - 1.0, 0.0), min(s + 1.0, length_of(line)))
    return bool(abs(turn(heading(near, end=True), heading(standing, end=True))) > HEAD_ON_RAD)


def _lane_moves(net: NetContent, room_m: float) -> dict[str, list[str]]:
    moves: dict[str, list[str]] = defaultdict(list)
    for link in car_links(net):
        moves[link.from_lane].append(link.to_lane)
    for names in net.edges.values():
        for right, left in pairwise(net.lanes[name] for name in names):
            if right.cars and left.cars and not right.internal and right.length_m >= room_m:
                moves[right.lane_id] += [left.lane_id] if right.change_left else []
                moves[left.lane_id] += [right.lane_id] if left.change_right else []
    return moves


def _paths(net: NetContent, moves: dict[str, list[str]], start: str) -> dict[str, tuple[str, ...]]:
    queue = [name for name in net.edges[start] if net.lanes[name].cars]
    passed: dict[str, tuple[str, ...]] = {name: (start,) for name in queue}
    paths: dict[str, tuple[str, ...]] = {start: (start,)}
    for name in queue:
        for ahead in moves.get(name, ()):
            edge = net.lanes[ahead].edge_id
            if ahead not in passed:
                passed[ahead] = passed[name] if edge == passed[name][-1] else (*passed[name], edge)
                paths.setdefault(edge, passed[ahead])
                queue.append(ahead)
    return paths


def _overlap(f: Figures) -> str:
    pairs = (f"{a} on {x} and {b} on {y} at {t:.1f} s" for a, x, b, y, t in f["overlaps"][:6])
    return f"{f['overlapping_pairs']} pairs of vehicles overlap: {'; '.join(pairs)}"


DRIVING = (
    Figure("vehicles", lambda d: d.vehicles),
    Figure("driven_routes", lambda d: d.routes),
    Figure(
        "arrived",
        lambda d: d.arrived,
        lambda f: f"{f['vehicles'] - f['arrived']} of {f['vehicles']} vehicles did not arrive",
        lambda f: f["arrived"] >= f["vehicles"],
    ),
    Figure("teleports", lambda d: d.teleports, "teleports"),
    Figure("collisions", lambda d: d.collisions, "collisions reported by SUMO"),
    Figure("overlapping_pairs", lambda d: len(d.overlaps), _overlap),
    Figure("overlaps", lambda d: d.overlaps),
    Figure("warnings", lambda d: d.warnings, "warnings while driving"),
)


def drive_net(net_path: Path, *, vehicles: int = 120, headway_s: float = 2.0) -> FidelityReport:
    """Let SUMO's own models drive all routes from the net's borders to its borders.

    Args:
        vehicles: how many; they take all routes in turn, in a random order.
    """
    driving = Driving(net_path, vehicles=vehicles, headway_s=headway_s)
    return FidelityReport(figures=measured(DRIVING, driving), table=DRIVING)


def judged(road: Road, net_path: Path) -> FidelityReport:
    """Convert a road, judge its net, and let 120 cars drive on it."""
    net = convert(road, net_path)
    report, driving = check_net(net.path, road, net.lanes), drive_net(net.path)
    return FidelityReport(figures=report.figures | driving.figures, table=report.table + driving.table)
