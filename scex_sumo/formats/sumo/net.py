"""SUMO net as a road, read with sumolib."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax import SAXException

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, ScexError, listed, reason_of
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.converters.naming import map_name, unpacked_name
from scex_sumo.converters.net.allowed import prune
from scex_sumo.converters.net.parts import BEYOND, LaneletPart, lane_names, lanelet_places, named_parts
from scex_sumo.converters.net.reading import allowed_content
from scex_sumo.converters.net.sumo_net import LANE_WIDTH_M
from scex_sumo.converters.registries import MapFormat
from scex_sumo.converters.xml import change_words, is_left_hand, net_root
from scex_sumo.formats.lane_maps.lane_links import overlapping
from scex_sumo.formats.lane_maps.lane_map import beside as _aside
from scex_sumo.formats.recognition import FCD_ENDINGS, is_sumo_net
from scex_sumo.geometry.polylines import arc_lengths, cut, length_of
from scex_sumo.lanelet2sumo.reader import MAX_M
from scex_sumo.road import Area, Lane, Marking, Regulation, Road

STRAIGHT_M = 5e-9  # a point this near to the line between its neighbours is none of the map's
MIN_LENGTH_M = 0.05  # lanes without length are extended to this
MAX_WIDTH_M, MAX_SPEED_MPS = 100.0, 1000.0
CHANGED = "the net was converted by scex-sumo and changed since: its lanes are read as they are now"
_STOPS = {"allway_stop": "all_way_stop", "priority_stop": "stop"}
_KINDS = (("passenger", "vehicle"), ("bus", "bus"), ("bicycle", "bicycle"), ("pedestrian", "pedestrian"))


def read_sumo_road(path: str | Path, **_: object) -> Road:
    """Read a net; its lanes are numbered from 1 in the order of the file.

    Lanes of a net that `convert` wrote are joined to those of its map again, with their ids. Borders lie half
    a width beside SUMO's shapes. A lane change is allowed between lanes for the same vehicles unless the net
    forbids it. Right of way is that of the junctions' requests.
    """
    path = Path(path)
    try:
        road = _road(path)
    except (SAXException, SyntaxError, LookupError, ValueError, AttributeError, TypeError) as error:
        raise MapError(
            f"{path}: sumolib cannot read it: {reason_of(error)[:200]}; build it again with netconvert"
        ) from None
    _try(path)
    return road


def _try(path: Path) -> None:
    """Load a net in SUMO in another process, because some inconsistent nets crash libsumo."""
    with _allowed_copy(path) as net:
        options = ("--net-file", net.name, "--end", "0", "--xml-validation", "never")
        said = run_program("sumo", *options, folder=net.parent, file_bytes=net.stat().st_size)
    if ends := [line.removeprefix("Error: ") for line in said if line.startswith("Error: sumo ")]:
        raise MapError(f"{path}: {ends[0]} when it loads this net; build it again with netconvert")


@contextmanager
def _allowed_copy(path: Path) -> Iterator[Path]:
    """Give SUMO a temporary copy of what is allowed in a net; errors name the net itself."""
    content, _ = allowed_content(path)
    with TemporaryFolder() as folder:
        copy = Path(folder) / "allowed.net.xml"
        copy.write_bytes(content)
        try:
            yield copy
        except ScexError as error:
            raise type(error)(str(error).replace(str(copy), str(path))) from None


def _road(path: Path) -> Road:
    root = net_root(path)
    left_out = prune(root)
    net, forbidden = _open(path, root)
    named = named_parts(root)
    numbers = {name: k + 1 for k, name in enumerate(lane_names(root))}
    sumo_lanes = {numbers[name]: net.getLane(name) for name in numbers}
    lanes = {i: _lane(i, lane, numbers) for i, lane in sumo_lanes.items()}
    left_hand = is_left_hand(root)
    lanes = _beside(lanes, numbers, forbidden, lefthand=left_hand)
    lines = {i: _line(lane, heights=True) for i, lane in sumo_lanes.items()}
    within = {i for i, lane in lanes.items() if lane.subtype.startswith(":")}
    if named:
        lanes = _put_together(named, {lane.subtype: lane for lane in lanes.values()})
        lines = {i: lane.centreline for i, lane in lanes.items()}
        numbers = {name: under[0][0] for name in named if (under := lanelet_places(named, name))}
        within = set(lanes) - {number for name, number in numbers.items() if not name.startswith(":")}
    before: dict[int, list[int]] = {}
    for i in lanes:
        for j in lanes[i].successors:
            before.setdefault(j, []).append(i)
    for i, lane in lanes.items():
        left, right = (_aside(lane.centreline, side * lane.width_m / 2) for side in (1, -1))
        known = tuple(before.get(i, ()))
        lanes[i] = replace(lane, predecessors=known, left_bound=left, right_bound=right)
    if not any(lane.kind == "vehicle" for lane in lanes.values()):
        raise MapError(f"{path}: no lane that passenger cars may use; give a net for them")
    notes: tuple[str, ...] = (CHANGED,) if named is None else ()
    if left_out:
        notes += (f"{path.name}: only roads and lights are read, without {listed(left_out)}",)
    return Road(
        name=map_name(path),
        lanes=overlapping(lanes, lines),
        regulations=tuple(_junction_rules(net, numbers)),
        markings=tuple(_markings(lanes, within)),
        areas=_areas(net),
        net=path,
        sumo_lanes=not named,
        left_hand=left_hand,
        notes=notes,
    )


def _put_together(named: Mapping[str, Sequence[LaneletPart]], lanes: Mapping[str, Lane]) -> dict[int, Lane]:
    """Join the lanelets of a net, by id, without bounds, predecessors and conflicts."""
    numbers = {lane.lane_id: name for name, lane in lanes.items()}
    parts: dict[int, list[tuple[LaneletPart, FloatArray]]] = {}
    following: dict[int, set[int]] = {}
    beside: dict[int, list[int | None]] = {}
    for name, stretches in named.items():
        lane = lanes[name]
        ends = np.cumsum([0.0, *(s.end - s.start for s in stretches)])
        if stretches[0].lanelet == BEYOND:  # the gap is at its end
            ends += length_of(lane.centreline) - ends[-1]
        for stretch, (start, end) in zip(stretches, pairwise(ends.tolist()), strict=True):
            parts.setdefault(stretch.lanelet, []).append((stretch, cut(lane.centreline, start, end)))
        after = [numbers[i] for i in lane.successors]
        transitions = [*pairwise(s.lanelet for s in stretches if s.lanelet != BEYOND)]
        transitions += [(stretches[-1].lanelet, named[other][0].lanelet) for other in after if other in named]
        for here, there in transitions:
            if here != there:
                following.setdefault(here, set()).add(there)
        near = [named.get(numbers.get(i or 0, "")) for i in (lane.left, lane.right)]
        own = beside.setdefault(stretches[0].lanelet, [None, None])
        for side, other_stretches in enumerate(near):
            own[side] = other_stretches[0].lanelet if other_stretches else own[side]
    kinds = {s.lanelet: lanes[name].kind for name, stretches in named.items() for s in stretches}
    parts.pop(BEYOND, None)
    joined = {}
    for i in sorted(parts):
        line, stretch, (left, right) = _joined(parts[i]), parts[i][0][0], beside.get(i, (None, None))
        joined[i] = Lane(
            lane_id=i,
            centreline=line,
            left_bound=line,
            right_bound=line,
            width_m=stretch.width,
            speed_limit_mps=stretch.speed,
            kind=kinds[i],
            successors=tuple(sorted(following.get(i, set()) - {BEYOND})),
            left=left,
            right=right,
            adjacent_left=left,
            adjacent_right=right,
        )
    return joined


def _joined(pieces: Sequence[tuple[LaneletPart, FloatArray]]) -> FloatArray:
    lines: list[FloatArray] = []
    reached = -np.inf
    for stretch, line in sorted(pieces, key=lambda piece: (piece[0].start, -piece[0].end)):
        if stretch.end <= reached + 1e-6:
            continue
        lines.append(cut(line, max(reached - stretch.start, 0.0), length_of(line)))
        reached = stretch.end
    return _without_cuts(np.vstack(lines))


def _without_cuts(line: FloatArray) -> FloatArray:
    line = line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > STRAIGHT_M])]
    kept = [0]
    for k in range(1, len(line) - 1):
        a, b, c = line[kept[-1]], line[k], line[k + 1]
        (dx, dy), (ex, ey) = c - a, b - a
        if abs(dx * ey - dy * ex) > STRAIGHT_M * max(float(np.hypot(dx, dy)), 1e-12):
            kept.append(k)
    return np.asarray(line[[*kept, len(line) - 1]])


def _open(path: Path, root: ElementTree.Element) -> tuple[Any, set[tuple[str, int]]]:
    import sumolib

    forbidden = {
        (lane.get("id", ""), side)
        for lane in root.iter("lane")
        for rule, side in zip(change_words(root), (1, -1), strict=True)
        if (allowed := lane.get(rule)) is not None and not {"all", "passenger"} & set(allowed.split())
    }
    net = sumolib.net.readNet(str(path), withInternal=True, withFoes=True)
    for lane in map(net.getLane, lane_names(root)):
        shape = np.array(lane.getShape3D(), dtype=np.float64)
        if not len(shape) or not (np.abs(shape) <= MAX_M).all():
            raise ValueError(f"lane {lane.getID()} has no shape")
        if not lane.getWidth() <= MAX_WIDTH_M or not 0.0 <= lane.getSpeed() <= MAX_SPEED_MPS:
            raise ValueError(f"lane {lane.getID()} is {lane.getWidth()} m wide, for {lane.getSpeed()} m/s")
    missing = [node.getID() for node in net.getNodes() if node.getType() is None]
    if missing:
        raise ValueError(f"no junction {missing[0]}")
    return net, forbidden


def _lane(number: int, lane: Any, numbers: Mapping[str, int]) -> Lane:
    centre = _line(lane)
    width = float(lane.getWidth()) if lane.getWidth() > 0 else LANE_WIDTH_M
    following = [link.getViaLaneID() or link.getToLane().getID() for link in lane.getOutgoing()]
    return Lane(
        lane_id=number,
        centreline=centre,
        left_bound=centre,
        right_bound=centre,
        width_m=width,
        speed_limit_mps=float(lane.getSpeed()),
        kind=next((kind for word, kind in _KINDS if lane.allows(word)), "other"),
        subtype=lane.getID(),
        successors=tuple(dict.fromkeys(numbers[name] for name in following if name in numbers)),
    )


def _line(lane: Any, *, heights: bool = False) -> FloatArray:
    points = np.array(lane.getShape3D(), dtype=np.float64)
    step = np.hypot(*np.diff(points[:, :2], axis=0).T)
    points = points[np.concatenate([[True], step > 1e-6])]
    if len(points) < 2:
        points = np.vstack([points[0], points[0] + [MIN_LENGTH_M, 0.0, 0.0]])
    return points if heights else points[:, :2]


def _beside(
    lanes: Mapping[int, Lane], numbers: Mapping[str, int], forbidden: set[tuple[str, int]], *, lefthand: bool
) -> dict[int, Lane]:
    left = -1 if lefthand else 1  # lane 0 is next to the kerb
    result = {}
    for i, lane in lanes.items():
        edge, _, index = lane.subtype.rpartition("_")
        there = {side: numbers.get(f"{edge}_{int(index) + side}") for side in (left, -left)}
        near = {side: j if j and lanes[j].kind == lane.kind else None for side, j in there.items()}
        closed = {side for side in near if edge.startswith(":") or (lane.subtype, side) in forbidden}
        free = {side: None if side in closed else near[side] for side in near}
        result[i] = replace(
            lane, left=free[left], right=free[-left], adjacent_left=near[left], adjacent_right=near[-left]
        )
    return result


def _markings(lanes: Mapping[int, Lane], within: Container[int]) -> list[Marking]:
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
    kinds = {"crossing": "crosswalk", "walkingarea": "walkway"}
    areas = []
    for k, edge in enumerate(e for e in net.getEdges(withInternal=True) if e.getFunction() in kinds):
        (lane, *_) = edge.getLanes()
        line = _line(lane)
        if edge.getFunction() == "crossing":
            width = float(lane.getWidth())
            line = np.vstack([_aside(line, width / 2), _aside(line, -width / 2)[::-1]])
        if len(line) > 2:
            areas.append(Area(area_id=k + 1, kind=kinds[edge.getFunction()], outline=line))
    return tuple(areas)


def _junction_rules(net: Any, numbers: Mapping[str, int]) -> Iterator[Regulation]:
    ids = count(1)
    for node in net.getNodes():
        links = {node.getLinkIndex(x): x for x in node.getConnections() if x.getViaLaneID() in numbers}
        links.pop(-1, None)
        kind, links = _STOPS.get(node.getType(), "right_of_way"), dict(sorted(links.items()))
        within = {k: numbers[link.getViaLaneID()] for k, link in links.items()}
        # The lane before a junction; the one in it if a converted map begins there.
        before = {k: numbers.get(link.getFromLane().getID()) or within[k] for k, link in links.items()}
        for k in links:
            response = node._prohibits.get(k, "")[::-1]
            over = tuple(within[j] for j in links if j != k and response[j : j + 1] == "1")
            if over:
                own, lane = (within[k],), (before[k],)
                yield Regulation(element_id=next(ids), kind=kind, lanes=lane, yielding=own, priority=over)
        if lit := dict.fromkeys(before[k] for k, link in links.items() if link.getTLSID()):
            number = next(ids)
            yield Regulation(element_id=number, kind="traffic_light", lanes=tuple(lit), lights=(number,))


def _tracks(path: Path) -> Path | None:
    names = (map_name(path), Path(unpacked_name(path)).stem)
    beside = [path.with_name(f"{name}{ending}") for name in names for ending in FCD_ENDINGS]
    return next((file for file in beside if file.is_file()), None)


SUMO_NET = MapFormat(
    is_mine=is_sumo_net,
    read=read_sumo_road,
    tracks=_tracks,
    asks_for="--tracks FILE (floating car data, a saved state or a CSV)",
)
