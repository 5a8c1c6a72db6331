"""SUMO net as the judge of a conversion sees it: plain XML, nothing shared with the net writer.

sumolib's reader would do but for one thing: it forgets which lane changes a lane forbids.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.errors import InputError
from scex_sumo.road import Georeference

DEFAULT_WIDTH_M = 3.2  # SUMO's own where a lane names none
CAR = "passenger"


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedLane:
    """One SUMO lane.

    Attributes:
        index: 0 is the rightmost lane of the edge.
        shape: (P, 2) m, in the map's coordinates (the net's offset is taken off).
        length_m: as written, which need not be the shape's.
        cars: passenger cars may use it.
        change_left: passenger cars may leave it to the left; ``change_right`` likewise.
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

    @cached_property
    def line(self) -> shapely.LineString:
        """The shape, for measuring."""
        return shapely.LineString(self.shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedLink:
    """One connection between two lanes of normal edges.

    Attributes:
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
        kind: SUMO's type, e.g. ``priority``, ``allway_stop``.
        response: (n, n) True where the row's link must give way to the column's.
        foes: (n, n) True where the two links are in each other's way.
    """

    kind: str
    response: BoolArray
    foes: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedNet:
    """Lanes, links and junctions of a net, by id.

    Attributes:
        edges: lane ids of each edge, from right to left.
        links: every connection between normal edges.
        following: lanes that a car enters right after a lane, internal ones included.
        offset: (2,) m that the file adds to the map's coordinates.
        phases: states of every phase of each traffic light, all its programmes together.
    """

    path: Path
    lanes: Mapping[str, JudgedLane]
    edges: Mapping[str, tuple[str, ...]]
    links: tuple[JudgedLink, ...]
    following: Mapping[str, tuple[str, ...]]
    junctions: Mapping[str, Junction]
    offset: FloatArray
    phases: Mapping[str, tuple[str, ...]]

    @cached_property
    def car_lanes(self) -> dict[str, JudgedLane]:
        """Lanes open to passenger cars."""
        return {i: lane for i, lane in self.lanes.items() if lane.cars}

    @cached_property
    def car_links(self) -> list[JudgedLink]:
        """Links between lanes open to passenger cars."""
        return [k for k in self.links if k.from_lane in self.car_lanes and k.to_lane in self.car_lanes]


def read_net(path: Path, place: Georeference | None = None) -> JudgedNet:
    """Read a SUMO net.

    Args:
        path: the net.
        place: of the map on Earth; a net with a projection is in its coordinates.

    Raises:
        InputError: the file is missing or no SUMO net.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except FileNotFoundError:
        raise InputError(f"{path}: no such net; convert the map first") from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter of its encoding
        raise InputError(f"{path}: not XML ({error}); give a SUMO .net.xml") from None
    if root.tag != "net":
        raise InputError(f"{path}: root element is <{root.tag}>, not <net>; give a SUMO .net.xml")
    offset = _offset(root.find("location"), place)
    lanes = {
        lane.attrib["id"]: _lane(edge, lane, offset)
        for edge in root.iter("edge")
        for lane in edge.iter("lane")
    }
    edges: dict[str, list[str]] = defaultdict(list)
    phases: dict[str, list[str]] = defaultdict(list)
    for lane in sorted(lanes.values(), key=lambda lane: (lane.edge_id, lane.index)):
        edges[lane.edge_id].append(lane.lane_id)
    for programme in root.iter("tlLogic"):
        phases[programme.attrib["id"]] += [phase.attrib["state"] for phase in programme.iter("phase")]
    following = _following(root, lanes)
    return JudgedNet(
        path=path,
        lanes=lanes,
        edges={i: tuple(ids) for i, ids in edges.items()},
        links=_links(root, following),
        following=following,
        junctions={junction.attrib["id"]: _junction(junction) for junction in root.iter("junction")},
        offset=offset,
        phases={i: tuple(states) for i, states in phases.items()},
    )


def _offset(location: Element | None, place: Georeference | None) -> FloatArray:
    """(2,) what the net's coordinates are ahead of the map's, m."""
    written = location.attrib if location is not None else {}
    offset: FloatArray = _points(written.get("netOffset") or "0,0")[0]
    if place is not None and written.get("projParameter", "").startswith("+proj"):
        offset = offset + np.array([place.east_m, place.north_m])
    return offset


def _permits_cars(element: Element, allow: str = "allow", disallow: str = "disallow") -> bool:
    """Whether an element's lists let passenger cars pass; neither list lets everyone."""
    allowed, banned = element.get(allow), element.get(disallow)
    if allowed:
        return allowed == "all" or CAR in allowed.split()
    return not banned or (banned != "all" and CAR not in banned.split())


def _points(text: str) -> FloatArray:
    return np.array([[float(v) for v in point.split(",")[:2]] for point in text.split()])


def _lane(edge: Element, lane: Element, offset: FloatArray) -> JudgedLane:
    return JudgedLane(
        lane_id=lane.attrib["id"],
        edge_id=edge.attrib["id"],
        index=int(lane.attrib["index"]),
        shape=_points(lane.attrib["shape"]) - offset,
        length_m=float(lane.attrib["length"]),
        speed_mps=float(lane.attrib["speed"]),
        width_m=float(lane.get("width", DEFAULT_WIDTH_M)),
        cars=_permits_cars(lane),
        change_left=_permits_cars(lane, "changeLeft", ""),
        change_right=_permits_cars(lane, "changeRight", ""),
        internal=edge.get("function") == "internal",
    )


def _ends(connection: Element) -> tuple[str, str]:
    """The lanes that a connection leaves and enters."""
    source = f"{connection.get('from')}_{connection.get('fromLane')}"
    return source, f"{connection.get('to')}_{connection.get('toLane')}"


def _following(root: Element, lanes: Mapping[str, JudgedLane]) -> dict[str, tuple[str, ...]]:
    following: dict[str, list[str]] = defaultdict(list)
    for connection in root.iter("connection"):
        source, target = _ends(connection)
        target = connection.get("via", target)
        both = source in lanes and target in lanes and lanes[source].cars and lanes[target].cars
        if both and _permits_cars(connection):
            following[source].append(target)
    return {i: tuple(ids) for i, ids in following.items()}


def _links(root: Element, following: Mapping[str, tuple[str, ...]]) -> tuple[JudgedLink, ...]:
    rows = {
        lane: (junction.attrib["id"], row)
        for junction in root.iter("junction")
        if junction.get("type") != "internal"
        for row, lane in enumerate(junction.get("intLanes", "").split())
    }
    links = []
    for connection in root.iter("connection"):
        if connection.get("from", "").startswith(":"):
            continue
        source, target = _ends(connection)
        chain: list[str] = []  # SUMO splits some ways through a junction at an internal one
        lane = connection.get("via")
        while lane is not None and lane.startswith(":") and lane not in chain:
            chain.append(lane)
            lane = next(iter(following.get(lane, ())), None)
        junction, row = next((rows[lane] for lane in chain if lane in rows), ("", -1))
        links.append(
            JudgedLink(
                from_lane=source,
                to_lane=target,
                via=tuple(chain),
                junction=junction,
                row=row,
                state=connection.get("state", ""),
                signal=connection.get("tl", ""),
                signal_index=int(connection.get("linkIndex", -1)),
            )
        )
    return tuple(links)


def _junction(junction: Element) -> Junction:
    requests = sorted(junction.iter("request"), key=lambda request: int(request.attrib["index"]))
    bits = np.zeros((2, len(requests), len(requests)), dtype=np.bool_)
    for row, request in enumerate(requests):
        for matrix, name in zip(bits, ("response", "foes"), strict=True):
            text = request.attrib[name][::-1][: len(requests)]  # SUMO writes link 0 last
            matrix[row, : len(text)] = [bit == "1" for bit in text]
    return Junction(kind=junction.get("type", ""), response=bits[0], foes=bits[1])
