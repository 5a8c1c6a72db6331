"""Reader of SUMO nets: lanes, links and junctions.

sumolib drops the lane changes that a lane forbids.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.net.links import SumoLink, lane_ids, links_of
from scex_sumo.converters.net.sumo_net import LANE_WIDTH_M, points_of
from scex_sumo.converters.xml import change_words, net_root, permits
from scex_sumo.road import Road

MAX_M = 1e8  # of coordinates
CAR = "passenger"

Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoLane:
    """A lane of a net.

    Attributes:
        index: 0 is the lane of the edge next to the kerb.
        length_m: as written, which may differ from the shape's.
        cars: whether passenger cars may use it; ``change_left`` to the next higher index and
            ``change_right`` are for them, too.
        function: of its edge: ``normal``, ``internal``, ``crossing`` or ``walkingarea``.
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
    function: str

    @property
    def internal(self) -> bool:
        """Whether it lies inside a junction."""
        return self.function == "internal"

    @cached_property
    def line(self) -> shapely.LineString:
        """The shape as a geometry."""
        return shapely.LineString(self.shape)


class _Junction(NamedTuple):
    kind: str
    response: BoolArray
    foes: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NetContent:
    """Lanes, links and junctions of a net, by id.

    Attributes:
        edges: lane ids of each edge, from right to left.
        following: lanes that a car enters after a lane, internal ones included.
        offset: (2,) m, the net's netOffset.
        phases: states of all phases of each traffic light.
    """

    path: Path
    lanes: Mapping[str, SumoLane]
    edges: Mapping[str, tuple[str, ...]]
    links: tuple[SumoLink, ...]
    following: Mapping[str, tuple[str, ...]]
    junctions: Mapping[str, _Junction]
    offset: FloatArray
    projected: bool
    phases: Mapping[str, tuple[str, ...]]

    @cached_property
    def car_lanes(self) -> dict[str, SumoLane]:
        """Lanes for passenger cars."""
        return {i: lane for i, lane in self.lanes.items() if lane.cars}

    def in_map(self, road: Road) -> NetContent:
        """Shift lane shapes to the coordinates of a road; ``offset`` is what they were ahead of these."""
        offset, place = self.offset, road.georeference
        if road.net is not None:
            offset = offset - _offset(net_root(road.net))
        elif place is not None and self.projected:
            offset = offset + np.array([place.east_m, place.north_m])
        lanes = {i: replace(lane, shape=lane.shape - offset) for i, lane in self.lanes.items()}
        return replace(self, lanes=lanes, offset=offset)


def read_net(path: Path) -> NetContent:
    """Read a SUMO net, in its own coordinates."""
    root = net_root(path)
    words, both = change_words(root), ((edge, x) for edge in root.iter("edge") for x in edge.iter("lane"))
    read = (_checked(path, element, _lane, edge, words) for edge, element in both)
    lanes = {lane.lane_id: lane for lane in read}
    edges: dict[str, list[str]] = defaultdict(list)
    for lane in sorted(lanes.values(), key=lambda lane: (lane.edge_id, lane.index)):
        edges[lane.edge_id].append(lane.lane_id)
    phases: dict[str, list[str]] = defaultdict(list)
    for programme in root.iter("tlLogic"):
        phases[programme.get("id", "")] += [phase.get("state", "") for phase in programme.iter("phase")]
    projection = next((x.get("projParameter", "!") for x in root.iter("location")), "!")
    return NetContent(
        path=path,
        lanes=lanes,
        edges={i: tuple(ids) for i, ids in edges.items()},
        links=tuple(links_of(root)),
        following=_following(root, lanes),
        junctions={j.get("id", ""): _checked(path, j, _junction) for j in root.iter("junction")},
        offset=_checked(path, root, _offset),
        projected=projection.startswith("+proj"),
        phases={i: tuple(states) for i, states in phases.items()},
    )


def _checked(path: Path, element: Element, make: Callable[..., Made], *context: Any) -> Made:
    try:
        return make(element, *context)
    except KeyError as error:
        problem = f"has no {error.args[0]}"
    except ValueError as error:
        problem = f"cannot be read ({error})"
    name = f"<{element.tag} id={element.get('id', '')!r}>"
    raise MapError(f"{path}: {name} {problem}; build the net again with netconvert") from None


def _lane(lane: Element, edge: Element, words: tuple[str, str]) -> SumoLane:
    shape = points_of(lane.attrib["shape"])
    if not len(shape) or not (np.abs(shape) <= MAX_M).all():
        raise ValueError("its shape has no points, or none on Earth")
    return SumoLane(
        lane_id=lane.attrib["id"],
        edge_id=edge.attrib["id"],
        index=int(lane.attrib["index"]),
        shape=shape,
        length_m=float(lane.attrib["length"]),
        speed_mps=float(lane.attrib["speed"]),
        width_m=float(lane.get("width", LANE_WIDTH_M)),
        cars=permits(lane, CAR),
        change_left=permits(lane, CAR, words[0], ""),
        change_right=permits(lane, CAR, words[1], ""),
        function=edge.get("function", "normal"),
    )


def _offset(root: Element) -> FloatArray:
    (offset,) = points_of(next((x.get("netOffset", "") for x in root.iter("location")), "") or "0,0")
    return np.asarray(offset)


def _following(root: Element, lanes: Mapping[str, SumoLane]) -> dict[str, tuple[str, ...]]:
    following: dict[str, list[str]] = defaultdict(list)
    for connection in root.iter("connection"):
        source, target = lane_ids(connection)
        target = connection.get("via", target)
        both = source in lanes and target in lanes and lanes[source].cars and lanes[target].cars
        if both and permits(connection, CAR):
            following[source].append(target)
    return {i: tuple(ids) for i, ids in following.items()}


def _junction(junction: Element) -> _Junction:
    requests = sorted(junction.iter("request"), key=lambda request: int(request.attrib["index"]))
    size = max(len(requests), len(junction.get("intLanes", "").split()))  # SUMO says what is missing
    bits = np.zeros((2, size, size), dtype=np.bool_)
    for row, request in enumerate(requests):
        for matrix, name in zip(bits, ("response", "foes"), strict=True):
            text = request.get(name, "")[::-1][:size]  # SUMO writes link 0 last
            matrix[row, : len(text)] = [bit == "1" for bit in text]
    return _Junction(junction.get("type", ""), *bits)
