"""Driving test of a net: SUMO's own vehicles all arrive, none overlap, none is teleported."""

from __future__ import annotations

import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.fidelity.net import JudgedLink, JudgedNet, read_net
from scex_sumo.converters.fidelity.routes import LENGTH_M, WIDTH_M, border_routes
from scex_sumo.errors import SimulationError
from scex_sumo.files import TemporaryFolder
from scex_sumo.programs import program

RUN_UP_M = 20.0  # braking distance at 50 km/h
STEP_S = 0.1
LOOK_S = 0.2  # footprints are compared this often
WAIT_S = 300.0  # SUMO's own: standing longer than this ends in a teleport, a deadlock
SHRINK_M = 0.02  # positions are written in centimetres
DRAIN_S = 900.0  # for the last vehicles to arrive, a deadlock included
LIMIT_S = 300.0  # wall clock
EMERGENCY = "emergency braking"
STANDOFF = "Suspicious right_before_left junction"
COUNTED = ("collision", "eleport", EMERGENCY, STANDOFF)  # warnings about what has a figure of its own
NAMED = 6
SEED = 0  # of the order of departures and of SUMO's own randomness


@dataclass(frozen=True, kw_only=True)
class DrivingReport:
    """How the vehicles fared.

    Attributes:
        vehicles: asked to drive; ``inserted`` those that entered the net, ``arrived`` those at their end.
        routes: different routes among them.
        teleports: vehicles that SUMO gave up on.
        collisions: those that SUMO reports.
        overlapping_pairs: pairs of vehicles whose footprints overlapped at some time.
        overlaps: (vehicle, lane, vehicle, lane, time in s) where each pair first did.
        emergency_brakings: vehicles that had to brake beyond their comfort's limit; SUMO's drivers do.
        standoffs: times that everyone at a crossing without rules waited for the one on the right; SUMO lets
            one of them go.
        warnings: what else SUMO wrote to its error stream.
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
        """Every figure by its name."""
        return asdict(self)

    def problems(self) -> list[str]:
        """What went wrong, one line each."""
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
        net_path: a SUMO net.
        vehicles: how many, one after the other, dealt out over all routes in an order drawn at random.
        headway_s: time between departures.

    Raises:
        InputError: the file is no SUMO net.
        SimulationError: the net has no route, or SUMO broke off.
    """
    net = read_net(net_path)
    routes = border_routes(net)
    if not routes:
        raise SimulationError(f"{net_path}: no route from border to border for cars; nothing to drive")
    order = np.random.default_rng(SEED).permutation(np.arange(vehicles) % len(routes))
    with TemporaryFolder() as folder:
        demand = Path(folder) / "demand.rou.xml"
        demand.write_text(_demand(net, [routes[k] for k in order], headway_s), encoding="utf-8")
        said = _simulate(net_path, demand, Path(folder), vehicles * headway_s + DRAIN_S)
        overlaps = _overlaps(Path(folder) / "fcd.xml")
        counts = ElementTree.parse(Path(folder) / "statistics.xml").getroot()
        trips = ElementTree.parse(Path(folder) / "trips.xml").getroot().findall("tripinfo")
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


def _demand(net: JudgedNet, routes: list[tuple[str, ...]], headway_s: float) -> str:
    """SUMO's routes file.

    Who starts just before a crossing or a merge starts from rest; on an edge shorter than a car, at its
    beginning, for SUMO leaves no gap to a car before that has turned elsewhere.
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


def _has_foes(net: JudgedNet, link: JudgedLink) -> bool:
    return bool(net.junctions[link.junction].foes[link.row].any())


def _simulate(net_path: Path, demand: Path, folder: Path, end_s: float) -> list[str]:
    options = {
        "--net-file": net_path,
        "--route-files": demand,
        "--end": end_s,
        "--step-length": STEP_S,
        "--seed": SEED,
        "--time-to-teleport": WAIT_S,
        "--collision.action": "warn",
        "--collision.check-junctions": "true",
        "--fcd-output": folder / "fcd.xml",
        "--fcd-output.attributes": "id,x,y,angle,lane",
        "--device.fcd.period": LOOK_S,
        "--tripinfo-output": folder / "trips.xml",
        "--statistic-output": folder / "statistics.xml",
        "--xml-validation": "never",
    }
    command = [program("sumo"), "--no-step-log", *(str(part) for pair in options.items() for part in pair)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
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
    """Each pair of vehicles whose footprints overlap, where and when they first do."""
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
    """(n, 4, 2) corners of the footprints; SUMO's position is the middle of the front bumper."""
    heading = np.deg2rad(90.0 - poses[:, 2])  # SUMO: 0 = north, clockwise
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[:, None]
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)[:, None]
    along = np.array([-SHRINK_M, -SHRINK_M, SHRINK_M - LENGTH_M, SHRINK_M - LENGTH_M])[:, None]
    across = np.array([0.5, -0.5, -0.5, 0.5])[:, None] * (WIDTH_M - 2 * SHRINK_M)
    corners: FloatArray = poses[:, None, :2] + along * ahead + across * left
    return corners
