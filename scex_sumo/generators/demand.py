"""Random traffic demand for a SUMO net: routes from border to border, random drivers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.converters.net.sumo_net import points_of
from scex_sumo.geometry.polylines import length_of, project
from scex_sumo.lanelet2sumo.reader import NetContent, read_net

LATERAL_MPS2 = 2.5  # usual in curves: 2 to 3
CURVE_WINDOW_M = 6.0  # shorter bends are kinks of the map
MIN_LIMIT_MPS = 4.0
CHANGE_M = 40.0  # for a planned lane change
MIN_ROAD_M = 30.0  # of a single road
MAX_ROUTE = 80  # edges
ROUND_TRIP = 12  # edges of a route in a net without exits
ROUTE_TRIES = 40
TRUCK_SHARE = 0.08
TRUCK_TOP_MPS = 24.0
SHORT_M = 2.5  # on a shorter lane a vehicle stands at its end
INSIDE_M = 1.5  # a nearer vehicle stands in the lane's traffic
END_M = 3.0  # points this near to a loose end may lie on the map's border


Place: TypeAlias = tuple[str, int]
"""Lane of a net: its edge, and its number from the right."""


@dataclass(frozen=True, kw_only=True)
class Trip:
    """Vehicle of the demand.

    Attributes:
        depart_s: wanted time of entry.
        lane: index of the entered lane.
        kind: ``car`` or ``truck``.
        driver: ``vType`` attributes.
    """

    depart_s: float
    lane: int
    edges: tuple[str, ...]
    kind: str
    length_m: float
    width_m: float
    driver: dict[str, str]


class Network:
    """Car lanes of a SUMO net, and random routes over them.

    Attributes:
        origins: lanes into the map; none begins on another lane.
    """

    def __init__(self, net_path: Path) -> None:
        net = read_net(net_path)
        self._lanes = {_place(name): lane for name, lane in net.car_lanes.items() if not lane.internal}
        self._onward: dict[Place, list[Place]] = {place: [] for place in self._lanes}
        for link in net.links:
            if _place(link.from_lane) in self._lanes:
                self._onward[_place(link.from_lane)].append(_place(link.to_lane))
        entered = {edge for onward in self._onward.values() for edge, _ in onward}
        left = {edge for (edge, _), onward in self._onward.items() if onward}
        self._exits = {edge for edge, _ in self._lanes if edge not in left}
        starts = [place for place in self._lanes if place[0] not in entered | self._exits]
        self.origins = sorted(set(starts) - _inside(net, starts, self._exits))
        # In a net without entries or exits, such as a grid, traffic begins and ends anywhere.
        self._endless = bool(left) and not (self.origins and self._exits)
        if not self.origins:
            long = {place for place, lane in self._lanes.items() if lane.length_m >= MIN_ROAD_M}
            roads = [place for place in long if place[0] in self._exits]
            self.origins = sorted(self._lanes if self._endless else roads)

    def random_route(self, origin: Place, rng: np.random.Generator) -> tuple[str, ...] | None:
        """Return the edges of a random route to the map's border, each fork equally likely."""
        longest = ROUND_TRIP if self._endless else MAX_ROUTE
        for _ in range(ROUTE_TRIES):
            edges, here = [origin[0]], origin
            while here[0] not in self._exits and len(edges) < longest:
                choices = self._next(here, edges)
                if not choices:
                    break
                here = choices[int(rng.integers(len(choices)))]
                edges.append(here[0])
            if here[0] in self._exits or (self._endless and len(edges) > 1):
                return tuple(edges)
        return None

    def _next(self, here: Place, done: list[str]) -> list[Place]:
        # Without room for a lane change the vehicle stays on its lane, unless it ends.
        room = self._lanes[here].length_m >= CHANGE_M or not self._onward[here]
        choices: dict[str, Place] = {}
        for place in self._reachable(here) if room else [here]:
            for to in self._onward[place]:
                if to in self._lanes and to[0] not in done:
                    choices.setdefault(to[0], to)
        return list(choices.values())

    def _reachable(self, here: Place) -> Iterator[Place]:
        yield here
        for step, may_change in ((1, "change_left"), (-1, "change_right")):
            edge, index = here
            while (edge, index + step) in self._lanes and getattr(self._lanes[edge, index], may_change):
                index += step
                yield edge, index


def random_trips(
    network: Network,
    *,
    until_s: float,
    every_s: tuple[float, float],
    rng: np.random.Generator,
    most_origins: int = 1_000,
) -> list[Trip]:
    """Return random vehicles by time of departure.

    Args:
        every_s: mean time between vehicles on an entry lane at the beginning and at the end; it changes
            geometrically and differs between lanes.
        most_origins: number of entry lanes, drawn at random if the net has more.
    """
    trips: list[Trip] = []
    origins = network.origins
    if len(origins) > most_origins:
        origins = [origins[k] for k in np.sort(rng.choice(len(origins), most_origins, replace=False))]
    for origin in origins:
        share, clock = rng.uniform(0.6, 1.6), 0.0
        while True:
            mean = every_s[0] * (every_s[1] / every_s[0]) ** (clock / until_s)
            clock += rng.exponential(mean / share)
            edges = network.random_route(origin, rng)
            if clock > until_s or edges is None:
                break
            trips.append(_trip(clock, origin[1], edges, rng))
    if not trips:
        raise SimulationError(
            f"no road of the map is {MIN_ROAD_M:g} m long or leads into another: nothing to populate; "
            "give a larger map"
        )
    return sorted(trips, key=lambda trip: trip.depart_s)


def write_trips(path: Path, trips: list[Trip]) -> None:
    """Write trips as SUMO routes; vehicle ``i`` is ``trips[i]``."""
    root = ElementTree.Element("routes")
    for i, trip in enumerate(trips):
        size = {"length": f"{trip.length_m:.2f}", "width": f"{trip.width_m:.2f}"}
        ElementTree.SubElement(root, "vType", {"id": f"t{i}", **size, **trip.driver})
        entry = {"depart": f"{trip.depart_s:.1f}", "departLane": str(trip.lane), "departSpeed": "max"}
        vehicle = ElementTree.SubElement(root, "vehicle", {"id": str(i), "type": f"t{i}", **entry})
        ElementTree.SubElement(vehicle, "route", {"edges": " ".join(trip.edges)})
    ElementTree.ElementTree(root).write(path, encoding="utf-8")


def write_curve_limits(net_path: Path, target: Path) -> None:
    """Copy a net with speed limits for its curves, which SUMO ignores."""
    tree = ElementTree.parse(net_path)
    for lane in tree.getroot().iter("lane"):
        sharpest = _sharpest(points_of(lane.get("shape", "")))
        limit = max(MIN_LIMIT_MPS, float(np.sqrt(LATERAL_MPS2 / max(sharpest, 1e-6))))
        lane.set("speed", f"{min(float(lane.get('speed', 13.89)), limit):.2f}")
    tree.write(target, encoding="utf-8")


def _place(name: str) -> Place:
    edge, _, index = name.rpartition("_")
    return edge, int(index)


def _inside(net: NetContent, starts: list[Place], exits: set[str]) -> set[Place]:
    edges = {edge for edge, _ in starts}
    apart = {f"{edge}_{index}": set(net.edges[edge]) for edge, index in starts}
    for link in net.links:
        if link.from_lane in apart:
            apart[link.from_lane] |= {*link.via[:1], link.to_lane}
    shapes = {name: lane.shape for name, lane in net.car_lanes.items()}
    loose = {name for name, lane in net.car_lanes.items() if lane.edge_id in edges | exits}
    low = {name: line.min(axis=0) - INSIDE_M for name, line in shapes.items()}
    high = {name: line.max(axis=0) + INSIDE_M for name, line in shapes.items()}

    def inside(start: str) -> bool:
        """Return whether a lane begins on another one, away from that one's own loose ends."""
        tips = shapes[start][[0, -1] if length_of(shapes[start]) < SHORT_M else [0]]
        return any(
            _is_on(shapes[name], tip, loose_ends=name in loose)
            for name in shapes.keys() - {start} - apart[start]
            for tip in tips
            if np.all(low[name] <= tip) and np.all(tip <= high[name])
        )

    return {_place(start) for start in apart if inside(start)}


def _is_on(line: FloatArray, point: FloatArray, *, loose_ends: bool) -> bool:
    """Return whether a point lies on a lane; points within 3 m of loose ends do not."""
    (s,), (gap,) = project(point[None], line)
    return bool(gap < INSIDE_M) and not (loose_ends and min(s, length_of(line) - s) < END_M)


def _sharpest(shape: FloatArray) -> float:
    step = np.diff(shape, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    step, length = step[length > 1e-6], length[length > 1e-6]
    if len(step) < 2:
        return 0.0
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    middle = np.cumsum(length) - length / 2
    s = np.arange(middle[0], middle[-1], 1.0)
    turned = np.interp(s + CURVE_WINDOW_M, middle, heading) - np.interp(s, middle, heading)
    return float(np.abs(turned).max() / CURVE_WINDOW_M) if len(s) else 0.0


def _trip(depart_s: float, lane: int, edges: tuple[str, ...], rng: np.random.Generator) -> Trip:
    truck = bool(rng.random() < TRUCK_SHARE)
    length = rng.uniform(8.0, 12.0) if truck else float(np.clip(rng.normal(4.5, 0.35), 3.6, 5.3))
    width = 2.5 if truck else float(np.clip(rng.normal(1.82, 0.07), 1.6, 2.0))
    accel = rng.uniform(0.9, 1.2) if truck else float(np.clip(rng.normal(1.8, 0.3), 1.2, 2.8))
    driver = {
        "carFollowModel": "EIDM",
        "accel": f"{accel:.2f}",
        "decel": f"{np.clip(rng.normal(3.0, 0.4), 2.0, 4.5):.2f}",
        "tau": f"{np.clip(rng.normal(1.3, 0.3), 0.8, 2.2):.2f}",
        "minGap": f"{np.clip(rng.normal(2.2, 0.5), 1.2, 4.0):.2f}",
        "speedFactor": f"{np.clip(rng.normal(0.98, 0.1), 0.75, 1.25):.3f}",
        "maxSpeed": f"{TRUCK_TOP_MPS if truck else 60.0:.1f}",
        # Lateral speed in proportion to speed: cars do not slide.
        "lcMaxSpeedLatStanding": "0",
        "lcMaxSpeedLatFactor": "0.15",
        "jmTimegapMinor": f"{np.clip(rng.normal(1.0, 0.3), 0.4, 2.0):.2f}",
        "impatience": f"{rng.uniform(0.0, 0.8):.2f}",
    }
    kind, sizes = "truck" if truck else "car", {"length_m": length, "width_m": width}
    return Trip(depart_s=depart_s, lane=lane, edges=edges, kind=kind, driver=driver, **sizes)
