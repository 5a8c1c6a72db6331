"""A SUMO net as the judge of a conversion sees it: plain XML, nothing shared with the net writer."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.errors import InputError

DEFAULT_WIDTH_M = 3.2  # SUMO's own where a lane names none
CAR = "passenger"


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLane:
    """One SUMO lane.

    Attributes:
        lane_id: SUMO's id.
        edge_id: its edge.
        index: 0 is the rightmost lane of the edge.
        shape: (P, 2) m, in the map's coordinates (the net's offset is taken off).
        length_m: as written, which need not be the shape's.
        speed_mps: limit.
        width_m: one for the whole lane.
        cars: passenger cars may use it.
        change_left: passenger cars may leave it to the left.
        change_right: passenger cars may leave it to the right.
        internal: inside a junction.
    """

    lane_id: str
    edge_id: str
    index: int
    shape: FloatArray
    length_m: float
    speed_mps: float
    width_m: float
    cars: bool
    change_left: bool
    change_right: bool
    internal: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """One connection between two lanes of normal edges.

    Attributes:
        from_lane: lane it leaves.
        to_lane: lane it enters.
        via: internal lanes in driving order; empty in nets without them.
        junction: the junction it lies in, or an empty string where no request row belongs to it.
        row: its row in the junction's requests, or -1.
        state: SUMO's link state, e.g. ``M``, ``m``, ``=``, ``Z``, ``o``.
        signal: id of the traffic light that controls it, or an empty string.
        signal_index: its place in that light's phases, or -1.
    """

    from_lane: str
    to_lane: str
    via: tuple[str, ...]
    junction: str
    row: int
    state: str
    signal: str
    signal_index: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Junction:
    """Right of way of one junction.

    Attributes:
        junction_id: SUMO's id.
        kind: SUMO's type, e.g. ``priority``, ``allway_stop``.
        response: (n, n) True where the row's link must give way to the column's.
        foes: (n, n) True where the two links are in each other's way.
    """

    junction_id: str
    kind: str
    response: BoolArray
    foes: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Net:
    """Lanes, links and junctions of a net.

    Attributes:
        path: the file.
        lanes: by id, internal ones included.
        edges: lane ids of each edge, from right to left.
        links: every connection between normal edges.
        following: lanes that a car enters right after a lane, internal ones included.
        junctions: by id.
        offset: (2,) m that the file adds to the map's coordinates.
        phases: states of every phase of each traffic light, all its programmes together.
    """

    path: Path
    lanes: Mapping[str, NetLane]
    edges: Mapping[str, tuple[str, ...]]
    links: tuple[Link, ...]
    following: Mapping[str, tuple[str, ...]]
    junctions: Mapping[str, Junction]
    offset: FloatArray
    phases: Mapping[str, tuple[str, ...]]

    @property
    def car_lanes(self) -> dict[str, NetLane]:
        """Lanes open to passenger cars."""
        return {i: lane for i, lane in self.lanes.items() if lane.cars}


def read_net(path: Path) -> Net:
    """Read a SUMO net.

    Raises:
        InputError: the file is missing or no SUMO net.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except FileNotFoundError:
        raise InputError(f"{path}: no such net; convert the map first") from None
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not XML ({error}); give a SUMO .net.xml") from None
    if root.tag != "net":
        raise InputError(f"{path}: root element is <{root.tag}>, not <net>; give a SUMO .net.xml")
    location = root.find("location")
    written = (location.get("netOffset") if location is not None else None) or "0,0"
    offset = np.array([float(value) for value in written.split(",")])
    lanes = _lanes(root, offset)
    edges: dict[str, list[str]] = defaultdict(list)
    for lane in sorted(lanes.values(), key=lambda lane: (lane.edge_id, lane.index)):
        edges[lane.edge_id].append(lane.lane_id)
    following = _following(root, lanes)
    return Net(
        path=path,
        lanes=lanes,
        edges={i: tuple(ids) for i, ids in edges.items()},
        links=_links(root, following),
        following=following,
        junctions=_junctions(root),
        offset=offset,
        phases=_phases(root),
    )


def permits_cars(allow: str | None, disallow: str | None) -> bool:
    """Whether SUMO's allow and disallow lists let passenger cars pass; neither list lets everyone."""
    if allow:
        return allow == "all" or CAR in allow.split()
    if disallow:
        return disallow != "all" and CAR not in disallow.split()
    return True


def _lanes(root: Element, offset: FloatArray) -> dict[str, NetLane]:
    lanes = {}
    for edge in root.iter("edge"):
        function = edge.get("function", "normal")
        for lane in edge.iter("lane"):
            shape = np.array(
                [[float(v) for v in point.split(",")[:2]] for point in lane.attrib["shape"].split()]
            )
            lanes[lane.attrib["id"]] = NetLane(
                lane_id=lane.attrib["id"],
                edge_id=edge.attrib["id"],
                index=int(lane.attrib["index"]),
                shape=shape - offset,
                length_m=float(lane.attrib["length"]),
                speed_mps=float(lane.attrib["speed"]),
                width_m=float(lane.get("width", DEFAULT_WIDTH_M)),
                cars=permits_cars(lane.get("allow"), lane.get("disallow")),
                change_left=permits_cars(lane.get("changeLeft"), None),
                change_right=permits_cars(lane.get("changeRight"), None),
                internal=function == "internal",
            )
    return lanes


def _following(root: Element, lanes: Mapping[str, NetLane]) -> dict[str, tuple[str, ...]]:
    following: dict[str, list[str]] = defaultdict(list)
    for connection in root.iter("connection"):
        if not permits_cars(connection.get("allow"), connection.get("disallow")):
            continue
        source, target = _ends(connection)
        target = connection.get("via", target)
        if source in lanes and target in lanes and lanes[source].cars and lanes[target].cars:
            following[source].append(target)
    return {i: tuple(ids) for i, ids in following.items()}


def _ends(connection: Element) -> tuple[str, str]:
    source = f"{connection.get('from')}_{connection.get('fromLane')}"
    return source, f"{connection.get('to')}_{connection.get('toLane')}"


def _links(root: Element, following: Mapping[str, tuple[str, ...]]) -> tuple[Link, ...]:
    rows: dict[str, tuple[str, int]] = {}
    for junction in root.iter("junction"):
        if junction.get("type") != "internal":
            for row, lane in enumerate(junction.get("intLanes", "").split()):
                rows[lane] = (junction.attrib["id"], row)
    links = []
    for connection in root.iter("connection"):
        if connection.get("from", "").startswith(":"):
            continue
        source, target = _ends(connection)
        chain = _via(connection.get("via"), following)
        junction_id, row = next((rows[lane] for lane in chain if lane in rows), ("", -1))
        links.append(
            Link(
                from_lane=source,
                to_lane=target,
                via=chain,
                junction=junction_id,
                row=row,
                state=connection.get("state", ""),
                signal=connection.get("tl", ""),
                signal_index=int(connection.get("linkIndex", -1)),
            )
        )
    return tuple(links)


def _via(first: str | None, following: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Internal lanes of one connection; SUMO splits some at an internal junction."""
    chain: list[str] = []
    lane = first
    while lane is not None and lane.startswith(":") and lane not in chain:
        chain.append(lane)
        lane = next(iter(following.get(lane, ())), None)
    return tuple(chain)


def _junctions(root: Element) -> dict[str, Junction]:
    junctions = {}
    for junction in root.iter("junction"):
        requests = sorted(junction.iter("request"), key=lambda request: int(request.attrib["index"]))
        junctions[junction.attrib["id"]] = Junction(
            junction_id=junction.attrib["id"],
            kind=junction.get("type", ""),
            response=_bits(requests, "response"),
            foes=_bits(requests, "foes"),
        )
    return junctions


def _phases(root: Element) -> dict[str, tuple[str, ...]]:
    phases: dict[str, list[str]] = defaultdict(list)
    for programme in root.iter("tlLogic"):
        phases[programme.attrib["id"]] += [phase.attrib["state"] for phase in programme.iter("phase")]
    return {i: tuple(states) for i, states in phases.items()}


def _bits(requests: list[Element], name: str) -> BoolArray:
    """(n, n) matrix of the rows; SUMO writes link 0 last."""
    count = len(requests)
    bits = np.zeros((count, count), dtype=np.bool_)
    for row, request in enumerate(requests):
        text = request.attrib[name][::-1]
        bits[row, : len(text)] = [bit == "1" for bit in text[:count]]
    return bits
