"""Driving test of a net: SUMO's own vehicles arrive without overlap or teleport."""

from __future__ import annotations

import subprocess
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import gettempdir
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import SimulationError, reason_of
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.programs import program
from scex_sumo.converters.net.reader import NetContent, SumoLane, SumoLink, read_net
from scex_sumo.geometry.polylines import cut, heading, length_of
from scex_sumo.judge.matching import angle_between

RUN_UP_M = 20.0  # braking distance at 50 km/h
STEP_S = 0.1
LOOK_S = 0.2  # footprints are compared this often
WAIT_S = 300.0  # SUMO's own: a vehicle that stands longer is teleported
SHRINK_M = 0.02  # positions are written in centimetres
DRAIN_S = 900.0  # for the last vehicles to arrive, a deadlock included
LIMIT_S = 300.0  # wall clock
EMERGENCY = "emergency braking"
STANDOFF = "Suspicious right_before_left junction"
COUNTED = ("collision", "eleport", EMERGENCY, STANDOFF)  # warnings about what has a figure of its own
NAMED = 6
NET = "driven.net.xml"
SEED = 0  # of the order of departures and of SUMO's own randomness


@dataclass(frozen=True, kw_only=True)
class DrivingReport:
    """Figures of the driving test.

    Attributes:
        overlapping_pairs: pairs of vehicles whose footprints overlapped.
        overlaps: (vehicle, lane, vehicle, lane, time in s) of each pair's first overlap.
        emergency_brakings: vehicles that braked beyond their comfortable limit.
        standoffs: times that all cars at a crossing waited for the one on the right.
        warnings: other lines of SUMO's error stream.
        duration_s: simulated time until the last arrival, or the end.
    """

    vehicles: int
    routes: int
    inserted: int
    arrived: int
    teleports: int
    collisions: int
    overlapping_pairs: int
    overlaps: tuple[tuple[str, str, str, str, float], ...]
    emergency_brakings: int
    standoffs: int
    warnings: tuple[str, ...]
    duration_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return every figure by its name."""
        return asdict(self)

    def problems(self) -> list[str]:
        """Return what went wrong, one line each."""
        overlaps = (f"{a} on {x} and {b} on {y} at {t:.1f} s" for a, x, b, y, t in self.overlaps[:NAMED])
        found = {
            f"{self.vehicles - self.arrived} of {self.vehicles} vehicles did not arrive": self.vehicles
            > self.arrived,
            f"{self.teleports} teleports": self.teleports,
            f"{self.collisions} collisions reported by SUMO": self.collisions,
            f"{self.overlapping_pairs} pairs of vehicles overlap: {'; '.join(overlaps)}": self.overlaps,
            f"{len(self.warnings)} warnings while driving: {''.join(self.warnings[:1])}": self.warnings,
        }
        return [words for words, wrong in found.items() if wrong]


def drive_net(net_path: Path, *, vehicles: int = 120, headway_s: float = 2.0) -> DrivingReport:
    """Let SUMO's own models drive all routes from the net's borders to its borders.

    Args:
        vehicles: how many; they take all routes in turn, in a random order.
    """
    net = read_net(net_path)
    routes = border_routes(net)
    if not routes:
        raise SimulationError(f"{net_path}: no route from border to border for cars; nothing to drive")
    order = np.random.default_rng(SEED).permutation(np.arange(vehicles) % len(routes))
    try:
        with TemporaryFolder() as folder:
            demand = Path(folder) / "demand.rou.xml"
            demand.write_text(_demand(net, [routes[k] for k in order], headway_s), encoding="utf-8")
            (Path(folder) / NET).symlink_to(net_path.resolve())
            said = _simulate(net_path, Path(folder), vehicles * headway_s + DRAIN_S)
            overlaps = _overlaps(Path(folder) / "fcd.xml")
            counts = ElementTree.parse(Path(folder) / "statistics.xml").getroot()
            trips = ElementTree.parse(Path(folder) / "trips.xml").getroot().findall("tripinfo")
    except (OSError, ElementTree.ParseError) as error:  # SUMO ends well when the disk is full
        raise SimulationError(
            f"{gettempdir()}: the temporary folder cannot hold the simulation ({reason_of(error)}); "
            "free some space, or set TMPDIR to another folder"
        ) from None
    return DrivingReport(
        vehicles=vehicles,
        routes=len(set(order.tolist())),
        inserted=_count(counts, "vehicles", "inserted"),
        arrived=sum(float(trip.get("arrival", -1.0)) >= 0.0 and not trip.get("vaporized") for trip in trips),
        teleports=_count(counts, "teleports", "total"),
        collisions=_count(counts, "safety", "collisions"),
        overlapping_pairs=len(overlaps),
        overlaps=tuple(overlaps),
        emergency_brakings=sum(EMERGENCY in line for line in said),
        standoffs=sum(STANDOFF in line for line in said),
        warnings=tuple(line for line in said if not any(word in line for word in COUNTED)),
        duration_s=max((float(trip.get("arrival", 0.0)) for trip in trips), default=0.0),
    )


def _demand(net: NetContent, routes: list[tuple[str, ...]], headway_s: float) -> str:
    """SUMO's routes file. Cars that start just before a crossing start from rest; on an edge shorter than a
    car they start at its beginning, because SUMO leaves no gap to a car before that has turned elsewhere.
    """
    size = f'length="{LENGTH_M}" width="{WIDTH_M}"'
    lines = [f'<routes><vType id="car" vClass="passenger" {size} sigma="0.5"/>']
    waiting = {
        net.lanes[link.from_lane].edge_id
        for link in net.car_links
        if net.lanes[link.from_lane].length_m < RUN_UP_M and link.row >= 0 and _has_foes(net, link)
    }
    for number, edges in enumerate(routes):
        speed = "0" if edges[0] in waiting else "max"
        place = "0" if net.lanes[net.edges[edges[0]][0]].length_m < LENGTH_M else "base"
        lines.append(
            f'<vehicle id="v{number}" type="car" depart="{number * headway_s}" departLane="best"'
            f' departPos="{place}" departSpeed="{speed}"><route edges="{" ".join(edges)}"/></vehicle>'
        )
    return "\n".join([*lines, "</routes>"])


def _has_foes(net: NetContent, link: SumoLink) -> bool:
    return bool(net.junctions[link.junction].foes[link.row].any())


def _simulate(net_path: Path, folder: Path, end_s: float) -> list[str]:
    options = {
        "--net-file": NET,
        "--route-files": "demand.rou.xml",
        "--end": end_s,
        "--step-length": STEP_S,
        "--seed": SEED,
        "--time-to-teleport": WAIT_S,
        "--collision.action": "warn",
        "--collision.check-junctions": "true",
        "--fcd-output": "fcd.xml",
        "--fcd-output.attributes": "id,x,y,angle,lane",
        "--device.fcd.period": LOOK_S,
        "--tripinfo-output": "trips.xml",
        "--statistic-output": "statistics.xml",
        "--xml-validation": "never",
    }
    command = [program("sumo"), "--no-step-log", *(str(part) for pair in options.items() for part in pair)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=LIMIT_S, check=False, cwd=folder
        )
    except subprocess.TimeoutExpired:
        raise SimulationError(
            f"{net_path}: driving took longer than {LIMIT_S:.0f} s; use fewer vehicles"
        ) from None
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode != 0:
        raise SimulationError(f"{net_path}: sumo ended with status {done.returncode}: {'; '.join(lines[:3])}")
    return lines


def _count(root: ElementTree.Element, tag: str, name: str) -> int:
    element = root.find(tag)
    return int(element.get(name, "0")) if element is not None else 0


def _overlaps(fcd: Path) -> list[tuple[str, str, str, str, float]]:
    found: dict[tuple[str, str], tuple[str, str, str, str, float]] = {}
    for _, element in ElementTree.iterparse(fcd):
        if element.tag != "timestep":
            continue
        cars = [dict(car.attrib) for car in element]
        time_s = float(element.attrib["time"])
        element.clear()
        if len(cars) < 2:
            continue
        poses = np.array([[float(car[key]) for key in ("x", "y", "angle")] for car in cars])
        boxes = shapely.polygons(_corners(poses))
        for i, j in shapely.STRtree(boxes).query(boxes, predicate="intersects").T:
            one, other = cars[i], cars[j]
            if i < j:
                overlap = (one["id"], one["lane"], other["id"], other["lane"], time_s)
                found.setdefault((one["id"], other["id"]), overlap)
    return list(found.values())


def _corners(poses: FloatArray) -> FloatArray:
    heading = np.deg2rad(90.0 - poses[:, 2])  # SUMO: 0 = north, clockwise
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[:, None]
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)[:, None]
    along = np.array([-SHRINK_M, -SHRINK_M, SHRINK_M - LENGTH_M, SHRINK_M - LENGTH_M])[:, None]
    across = np.array([0.5, -0.5, -0.5, 0.5])[:, None] * (WIDTH_M - 2 * SHRINK_M)
    corners: FloatArray = poses[:, None, :2] + along * ahead + across * left
    return corners


LENGTH_M = 4.7  # of a car
WIDTH_M = 1.8
CHANGE_M = 10.0  # shorter edges have no room for two cars to swap lanes
HEAD_ON_RAD = np.deg2rad(150.0)


def border_routes(net: NetContent) -> list[tuple[str, ...]]:
    """Return the shortest route in edges for every pair of border edges that lanes connect.

    Routes leave room for lane changes, if any does. Without borders they start and end anywhere. No route
    begins where a car would block others.
    """
    edges = {lane.edge_id for lane in net.car_lanes.values() if not lane.internal}
    entered = {net.lanes[link.to_lane].edge_id for link in net.car_links}
    left = {net.lanes[link.from_lane].edge_id for link in net.car_links}
    first = edges - entered
    starts, ends = first - _in_the_way(net, first) or first or edges, edges - left or edges
    alone = edges - entered - left
    for room_m in (CHANGE_M, 0.0):
        moves = _lane_moves(net, room_m)
        routes = [
            path
            for start in sorted(starts)
            for end, path in sorted(_paths(net, moves, start).items())
            if end in ends and (end != start or start in alone)
        ]
        if routes:
            break
    return routes


def _in_the_way(net: NetContent, starts: set[str]) -> set[str]:
    cars = {name: lane for name, lane in net.car_lanes.items() if length_of(lane.shape) > 0.0}
    apart = {name: set(net.edges[lane.edge_id]) for name, lane in cars.items() if lane.edge_id in starts}
    if not apart:  # a closed circuit
        return set()
    for link in net.car_links:
        if link.from_lane in apart:
            apart[link.from_lane] |= {*link.via, link.to_lane}
    order = sorted(apart, key=lambda name: (-cars[name].length_m, name))
    source = {via: link.from_lane for link in net.car_links if link.from_lane in apart for via in link.via}
    beside: dict[str, set[str]] = {name: set() for name in order}
    for name, other in _too_near(cars, {i: _standing(cars[i].shape) for i in order}, apart):
        passing = source.get(other, other)
        beside[name].add(passing)
        if passing in beside:
            beside[passing].add(name)
    allowed: set[str] = set()
    for name in order:
        if not beside[name] - (apart.keys() - allowed):
            allowed.add(name)
    return {cars[name].edge_id for name in apart.keys() - allowed}


def _too_near(
    cars: Mapping[str, SumoLane], standing: Mapping[str, FloatArray], apart: Mapping[str, Iterable[str]]
) -> Iterator[tuple[str, str]]:
    names, order = list(cars), list(standing)
    driven = [
        np.vstack([*([standing[i][:1]] if i in standing else []), lane.shape]) for i, lane in cars.items()
    ]
    tree = shapely.STRtree([shapely.LineString(line) for line in driven])
    stands = [shapely.LineString(line) for line in standing.values()]
    for k, j in tree.query(stands, predicate="dwithin", distance=WIDTH_M).T.tolist():
        name, other = order[k], names[j]
        if other not in apart[name] and not _head_on(standing[name], cars[other].shape):
            yield name, other


def _standing(line: FloatArray) -> FloatArray:
    length = length_of(line)
    if length >= LENGTH_M:
        return cut(line, 0.0, LENGTH_M)
    angle = heading(line, end=False)
    back = LENGTH_M * np.array([np.cos(angle), np.sin(angle)])
    return np.vstack([line[0] - back, line])


def _head_on(standing: FloatArray, line: FloatArray) -> bool:
    at, to = shapely.LineString(line), shapely.LineString(standing)
    s = at.project(shapely.shortest_line(at, to).interpolate(0.0))
    near = cut(line, max(s - 1.0, 0.0), min(s + 1.0, length_of(line)))
    ways = (heading(near, end=True), heading(standing, end=True))
    return bool(abs(angle_between(*map(np.float64, ways))) > HEAD_ON_RAD)


def _lane_moves(net: NetContent, room_m: float) -> dict[str, list[str]]:
    moves: dict[str, list[str]] = defaultdict(list)
    for link in net.car_links:
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
