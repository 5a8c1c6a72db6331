"""Road of a SUMO net: every lane, those within junctions too, as a lane; read with sumolib."""

from __future__ import annotations

import subprocess
import zlib
from collections.abc import Container, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax import SAXException

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.formats import map_name, open_binary
from scex_sumo.converters.sumo.lanelets import lanelet_places, named_parts, put_together
from scex_sumo.converters.sumo.rules import junction_rules
from scex_sumo.errors import MapError, reason_of
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.programs import environment, program
from scex_sumo.road import Area, Lane, Marking, Road
from scex_sumo.roads.overlaps import overlapping

WIDTH_M = 3.2  # SUMO's where a net gives none
SHORTEST_M = 0.05  # lanes of no length are drawn out to this
LARGEST_M, WIDEST_M, FASTEST_MPS = 1e8, 100.0, 1000.0  # of coordinates, lanes and speed limits
SHARPEST = 3.0  # corners of borders reach out at most this many times the half width
CHANGED = "the net was converted by scex-sumo and changed since: its lanes are read as they are now"
_DRIVEN = ("normal", "", None, "internal")
_KINDS = (("passenger", "vehicle"), ("bus", "bus"), ("bicycle", "bicycle"), ("pedestrian", "pedestrian"))


def read_sumo_road(path: str | Path) -> Road:
    """Read a net; its lanes are numbered from 1 in the order of the file, and it is driven as it is.

    Where `convert` wrote it, its lanes for vehicles are put together to the map's again, with their ids.
    Crossings and walking areas are drawn, not driven. Centrelines are SUMO's shapes, borders lie half a width
    beside them. A lane may be changed to where both are for the same vehicles and the net does not forbid
    it. Who gives way is what the requests of the junctions say.

    Args:
        path: a ``.net.xml``, or one that is gzipped.

    Raises:
        MapError: the net cannot be read, or has no lane for cars.
    """
    path = Path(path)
    try:
        road = _road(path)
    except (SAXException, LookupError, ValueError, AttributeError, TypeError) as error:
        raise MapError(
            f"{path}: sumolib cannot read it: {reason_of(error)[:200]}; build it again with netconvert"
        ) from None
    _try(path)
    return road


def _try(path: Path) -> None:
    """Have SUMO load a net in a process of its own: some that do not hang together end libsumo's."""
    command = [program("sumo"), "--net-file", str(path), "--end", "0", "--xml-validation.net", "never"]
    done = subprocess.run(command, capture_output=True, env=environment(), check=False)
    if done.returncode < 0:
        raise MapError(f"{path}: SUMO dies of this net; build it again with netconvert")


def _road(path: Path) -> Road:
    net, forbidden = _open(path)
    named = named_parts(_root(path))
    numbers = {name: k + 1 for k, name in enumerate(lane_names(path))}
    sumo_lanes = {numbers[name]: net.getLane(name) for name in numbers}
    following = {i: _following(lane, numbers) for i, lane in sumo_lanes.items()}
    lanes = {i: _lane(i, lane, following[i]) for i, lane in sumo_lanes.items()}
    lanes = _beside(lanes, sumo_lanes, numbers, forbidden)
    lines = {i: _line(lane, heights=True) for i, lane in sumo_lanes.items()}
    within = {i for i, lane in lanes.items() if lane.subtype.startswith(":")}
    if named:
        lanes = put_together(named, {lane.subtype: lane for lane in lanes.values()})
        lines = {i: lane.centreline for i, lane in lanes.items()}
        numbers = {name: under[0][0] for name in named if (under := lanelet_places(named, name))}
        within = set(lanes) - {number for name, number in numbers.items() if not name.startswith(":")}
    lanes = {i: _bounded(lane) for i, lane in _with_predecessors(lanes).items()}
    if not any(lane.kind == "vehicle" for lane in lanes.values()):
        raise MapError(f"{path}: no lane that passenger cars may use; give a net for them")
    return Road(
        name=map_name(path),
        lanes=overlapping(lanes, lines),
        regulations=junction_rules(net, numbers),
        markings=tuple(_markings(lanes, within)),
        areas=_areas(net),
        net=path,
        notes=(CHANGED,) if named is None else (),
    )


def lane_places(path: Path) -> list[tuple[str, list[tuple[int, float]]]]:
    """Each lane of a net with the lanes of its road under it, and where it begins on them, m."""
    named = named_parts(_root(path))
    if named:
        return [(name, under) for name in named if (under := lanelet_places(named, name))]
    return [(name, [(k + 1, 0.0)]) for k, name in enumerate(lane_names(path))]


def _with_predecessors(lanes: Mapping[int, Lane]) -> dict[int, Lane]:
    before: dict[int, list[int]] = {}
    for i in lanes:
        for j in lanes[i].successors:
            before.setdefault(j, []).append(i)
    return {i: replace(lane, predecessors=tuple(before.get(i, ()))) for i, lane in lanes.items()}


def _bounded(lane: Lane) -> Lane:
    """A lane with bounds half a width beside its centreline."""
    left, right = (beside(lane.centreline, side * lane.width_m / 2) for side in (1, -1))
    return replace(lane, left_bound=left, right_bound=right)


def lane_names(path: Path) -> list[str]:
    """SUMO's lanes of a net that become lanes of the road, in the order of the file."""
    return [
        lane.get("id", "")
        for edge in _root(path).iter("edge")
        if edge.get("function") in _DRIVEN
        for lane in edge.iter("lane")
    ]


def unpacked(path: Path) -> bytes:
    """Content of a net or another file of SUMO's, gzipped or not."""
    try:
        with open_binary(path) as file:
            return file.read()
    except (OSError, EOFError, zlib.error) as error:
        raise MapError(f"{path}: cannot be read: {error}; check the path of the net") from None


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(unpacked(path))
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter of its encoding
        raise MapError(f"{path}: no XML ({error}); build the net again with netconvert") from None
    if root.tag != "net":
        raise MapError(f"{path}: no SUMO net, its root element is <{root.tag}>; give a .net.xml")
    return root


def _open(path: Path) -> tuple[Any, set[tuple[str, int]]]:
    """The net, and the lane changes that it forbids (lane, 1 for left or -1 for right)."""
    import sumolib

    forbidden = {
        (lane.get("id", ""), side)
        for lane in _root(path).iter("lane")
        for rule, side in (("changeLeft", 1), ("changeRight", -1))
        if (allowed := lane.get(rule)) is not None and not {"all", "passenger"} & set(allowed.split())
    }
    net = sumolib.net.readNet(str(path), withInternal=True, withFoes=True)
    for name in lane_names(path):
        _check_lane(net.getLane(name))
    missing = [node.getID() for node in net.getNodes() if node.getType() is None]
    if missing:
        raise ValueError(f"no junction {missing[0]}")
    return net, forbidden


def _check_lane(lane: Any) -> None:
    """Raise a `ValueError` for a lane of impossible shape, width or speed."""
    shape = np.array(lane.getShape3D(), dtype=np.float64)
    if not len(shape) or not (np.abs(shape) <= LARGEST_M).all():
        raise ValueError(f"lane {lane.getID()} has no shape")
    if not lane.getWidth() <= WIDEST_M or not 0.0 <= lane.getSpeed() <= FASTEST_MPS:
        raise ValueError(f"lane {lane.getID()} is {lane.getWidth()} m wide, for {lane.getSpeed()} m/s")


def _following(lane: Any, numbers: Mapping[str, int]) -> tuple[int, ...]:
    """Lanes that follow: those within the junction, where the net has these."""
    found = [link.getViaLaneID() or link.getToLane().getID() for link in lane.getOutgoing()]
    return tuple(dict.fromkeys(numbers[name] for name in found if name in numbers))


def _lane(number: int, lane: Any, following: tuple[int, ...]) -> Lane:
    centre = _line(lane)
    width = float(lane.getWidth()) if lane.getWidth() > 0 else WIDTH_M
    return Lane(
        lane_id=number,
        centreline=centre,
        left_bound=centre,
        right_bound=centre,
        width_m=width,
        speed_limit_mps=float(lane.getSpeed()),
        kind=next((kind for word, kind in _KINDS if lane.allows(word)), "other"),
        subtype=lane.getID(),
        successors=following,
    )


def _line(lane: Any, *, heights: bool = False) -> FloatArray:
    """(P, 2) or, with heights, (P, 3) shape of a lane, without repeated points."""
    points = np.array(lane.getShape3D(), dtype=np.float64)
    step = np.hypot(*np.diff(points[:, :2], axis=0).T)
    points = points[np.concatenate([[True], step > 1e-6])]
    if len(points) < 2:
        points = np.vstack([points[0], points[0] + [SHORTEST_M, 0.0, 0.0]])
    return points if heights else points[:, :2]


def beside(line: FloatArray, offset: float) -> FloatArray:
    """A polyline beside another one, point by point; positive offsets are on the left, m."""
    step = np.diff(line, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(*step.T)[:, None]
    before, after = np.vstack([normal[:1], normal]), np.vstack([normal, normal[-1:]])
    both = before + after
    scale = np.maximum((both**2).sum(axis=1) / 2, 2 / SHARPEST)
    return np.asarray(line + offset * both / scale[:, None])


def _beside(
    lanes: Mapping[int, Lane],
    sumo_lanes: Mapping[int, Any],
    numbers: Mapping[str, int],
    forbidden: set[tuple[str, int]],
) -> dict[int, Lane]:
    """The lanes with their neighbours in the same edge."""
    found = {}
    for i, lane in lanes.items():
        own = sumo_lanes[i]
        edge, index = own.getEdge(), own.getIndex()
        near: dict[int, int | None] = {}
        for side in (1, -1):
            at = index + side
            there = edge.getLanes()[at] if 0 <= at < edge.getLaneNumber() else None
            number = None if there is None else numbers.get(there.getID())
            near[side] = number if number is not None and lanes[number].kind == lane.kind else None
        free = {
            side: None if (own.getID(), side) in forbidden or edge.getFunction() == "internal" else near[side]
            for side in near
        }
        found[i] = replace(lane, left=free[1], right=free[-1], adjacent_left=near[1], adjacent_right=near[-1])
    return found


def _markings(lanes: Mapping[int, Lane], within: Container[int]) -> list[Marking]:
    """Borders of roads, and dashed lines where one may change; nothing within junctions."""
    markings = []
    for i, lane in lanes.items():
        if i in within or arc_lengths(lane.centreline)[-1] < 1.0:
            continue
        if lane.adjacent_right is None:
            markings.append(Marking(line_id=2 * i, kind="road_border", subtype="", points=lane.right_bound))
        crossed = "dashed" if lane.left is not None else "solid"
        kind = "line_thin" if lane.adjacent_left is not None else "road_border"
        markings.append(Marking(line_id=2 * i + 1, kind=kind, subtype=crossed, points=lane.left_bound))
    return markings


def _areas(net: Any) -> tuple[Area, ...]:
    """Where people walk."""
    kinds = {"crossing": "crosswalk", "walkingarea": "walkway"}
    areas = []
    for k, edge in enumerate(e for e in net.getEdges(withInternal=True) if e.getFunction() in kinds):
        (lane, *_) = edge.getLanes()
        line = _line(lane)
        if edge.getFunction() == "crossing":
            width = float(lane.getWidth())
            line = np.vstack([beside(line, width / 2), beside(line, -width / 2)[::-1]])
        if len(line) > 2:
            areas.append(Area(area_id=k + 1, kind=kinds[edge.getFunction()], outline=line))
    return tuple(areas)
