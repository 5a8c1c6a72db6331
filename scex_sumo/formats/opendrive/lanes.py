"""Lanes of OpenDRIVE: borders, links through roads and junctions, markings, signals, priorities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.tags import COUNTRIES, KMH, MPH
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import MapFormat
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.formats.opendrive.roads import KINDS, DrawnRoad, Name, number
from scex_sumo.formats.recognition import is_opendrive
from scex_sumo.road import Road

End: TypeAlias = tuple[Name, bool]  # a lane, and whether it is its end along the reference line

TINY_M = 0.1  # shorter pieces are passed over
EXACT_M = 5e-4  # borders without the points that straight lines between their neighbours pass
UNITS = {"km/h": KMH, "mph": MPH}
LIGHTS = ("1000001", "1000008", "1000009", "1000010", "1000011", "1000012", "1000013")
SIGNS = {"206": "stop", "R1-1": "stop", "205": "yield", "R1-2": "yield"}
_MARKS = {"curb": ("curbstone", ""), "edge": ("road_border", ""), "grass": ("road_border", "")}


@dataclass(kw_only=True, eq=False)
class OpenDriveMap(DrawnMap):
    """What an OpenDRIVE map draws.

    Attributes:
        signals: id of the light of each lane, by name.
        roads: by id.
    """

    signals: dict[Name, str] = field(default_factory=dict)
    roads: Mapping[str, DrawnRoad] = field(default_factory=dict)


def read_opendrive(path: str | Path, **_: object) -> Road:
    """Read an OpenDRIVE file; its coordinates stay the file's."""
    path = Path(path)
    return opendrive_road(path, unpacked(path))


def opendrive_road(path: Path, content: bytes) -> Road:
    """Return the road of an OpenDRIVE text that stands in a file."""
    root = xml_root(path, content, "export the map again")
    signed = next((x.get("country", "").lower() for x in root.iterfind("road/type") if x.get("country")), "")
    country = signed if signed in COUNTRIES else None
    projection = (root.findtext("header/geoReference") or "").strip()
    projection = projection if projection.startswith("+proj") else ""
    with refusing_damage(MapError, path, "road of OpenDRIVE"):
        drawn = opendrive_map(path, root)
        return drawn_road(drawn, name=map_name(path), country=country, projection=projection)


def opendrive_map(path: Path, root: Element) -> OpenDriveMap:
    """Return the lanes of an OpenDRIVE file.

    Raises:
        MapError: a number is not finite, or no road has geometry and lanes.
    """
    drawn = OpenDriveMap(path=path, moved=False)
    whole = [x for x in root.findall("road") if x.find("planView/geometry") is not None]
    whole = [x for x in whole if x.find("lanes/laneSection") is not None]
    roads = {road.name: road for road in (DrawnRoad(path, x) for x in whole) if road.pieces}
    if left_out := [x.get("id", "?") for x in root.findall("road") if x.get("id", "") not in roads]:
        drawn.note("roads without geometry or lanes left out", *left_out)
    if not roads:
        raise MapError(f"{path}: none of its {len(left_out)} roads has geometry and lanes; export it again")
    drawn.roads = roads
    drawn.left_hand = 2 * sum(road.left_hand for road in roads.values()) > len(roads)
    after, before, tiny = _links(root, roads)
    for road in roads.values():
        for name in road.names():
            if name not in tiny:
                drawn.lanes.append(_lane(road, name, after, before))
        drawn.lines += _lines(road)
    signals = {x.get("id", ""): x for x in root.iter("signal")}
    for road in roads.values():
        _signals(drawn, road, signals, tiny)
    of = {key: [name for name in road.names() if name not in tiny] for key, road in roads.items()}
    for rule in root.iterfind("junction/priority"):
        drawn.priority.append((of.get(rule.get("low", ""), []), of.get(rule.get("high", ""), [])))
    return drawn


def _lane(
    road: DrawnRoad, name: Name, after: Mapping[Name, list[Name]] | None, before: Mapping[Name, list[Name]]
) -> DrawnLane:
    _, k, i = name
    piece, forward = road.pieces[k], road.forward(k, i)
    heights, (right, left) = road.heights[piece.rows], piece.borders[i]
    lines = [_exact(road.line.beside(t, piece.rows), heights) for t in ((left + right) / 2, left, right)]
    ids = sorted(piece.elements)
    above, below = ids[ids.index(i) + 1 :], ids[: ids.index(i)][::-1]
    # The mark of a border is that of the lane within, towards the reference line.
    marks = [piece.mark(near[0] if near[:1] and (i > 0) == (near is below) else i) for near in (above, below)]
    beside = [[(road.name, k, j) for j in near if j][:1] for near in (above, below)]
    for names in beside:
        names[:] = [n for n in names if n[2] in piece.lanes and road.forward(k, n[2]) == forward]
    if not forward:
        lines, marks, beside = [lines[0][::-1], lines[2][::-1], lines[1][::-1]], marks[::-1], beside[::-1]
    place = road.type_at(piece.middle_s)
    kind = place.get("type", "")
    return DrawnLane(
        name=name,
        centre=lines[0],
        left=lines[1],
        right=lines[2],
        kind=KINDS.get(piece.elements[i].get("type", ""), "other"),
        subtype="highway" if kind == "motorway" else "road",
        location="nonurban" if kind in ("motorway", "rural") else "urban",
        limit_mps=_limit(piece.elements[i].find("speed")) or _limit(place.find("speed")),
        inside=road.inside,
        closed=tuple(side for side, mark in zip(("left", "right"), marks, strict=True) if _closed(mark)),
        successors=None if after is None else after.get(name, []),
        predecessors=before.get(name, []),
        left_neighbours=beside[0],
        right_neighbours=beside[1],
    )


def _exact(points: FloatArray, heights: FloatArray) -> FloatArray:
    line = shapely.LineString(np.column_stack([points, heights]))
    with np.errstate(invalid="ignore", over="ignore"):  # a damaged file's numbers; its lanes are left out
        return np.asarray(shapely.get_coordinates(shapely.simplify(line, EXACT_M), include_z=True))


def _limit(speed: Element | None) -> float | None:
    try:
        return None if speed is None else float(speed.get("max", "")) * UNITS.get(speed.get("unit", ""), 1.0)
    except ValueError:  # no limit
        return None


def _closed(mark: Element) -> bool:
    if change := mark.get("laneChange"):
        return change != "both"
    return any(word in mark.get("type", "") for word in ("solid", "curb", "grass"))


def _lines(road: DrawnRoad) -> Iterator[tuple[str, str, FloatArray]]:
    for piece in road.pieces:
        for i in (0, *piece.lanes):
            shown = piece.mark(i).get("type", "none")
            near = i or next((j for j in (-1, 1) if j in piece.borders), None)
            if shown == "none" or near is None:
                continue
            t = piece.borders[near][int((i > 0) or (i == 0 and near < 0))]
            kind = _MARKS.get(shown, ("line_thin", "solid" if "solid" in shown else "dashed"))
            yield *kind, _exact(road.line.beside(t, piece.rows), road.heights[piece.rows])


def _links(
    root: Element, roads: Mapping[str, DrawnRoad]
) -> tuple[dict[Name, list[Name]] | None, dict[Name, list[Name]], set[Name]]:
    """Return the lanes behind and before each lane (None if the file links none), and those passed over."""
    known = {name for road in roads.values() for name in road.names()}
    joints: dict[End, set[End]] = {}

    def join(first: End, second: End) -> None:
        if first[0] in known and second[0] in known:
            joints.setdefault(first, set()).add(second)
            joints.setdefault(second, set()).add(first)

    for road in roads.values():
        for first, second in (*_through(road), *_onward(road, roads)):
            join(first, second)
    for first, second in _connections(root, roads):
        join(first, second)
    lengths = {
        (road.name, k): piece.length_m for road in roads.values() for k, piece in enumerate(road.pieces)
    }
    tiny = {name for name in known if lengths[name[:2]] < TINY_M}
    for name in tiny:
        ends = [joints.pop((name, at_end), set()) for at_end in (True, False)]
        for near in (end for partners in ends for end in partners):
            joints[near] -= {(name, True), (name, False)}
        for first in ends[0]:
            for second in ends[1] - {first}:
                join(first, second)
    after: dict[Name, list[Name]] = {}
    before: dict[Name, list[Name]] = {}
    for (lane, at_end), partners in joints.items():
        for beyond, beyond_end in sorted(partners):
            leaves = roads[lane[0]].forward(*lane[1:]) == at_end
            if leaves and roads[beyond[0]].forward(*beyond[1:]) != beyond_end:
                after.setdefault(lane, []).append(beyond)
                before.setdefault(beyond, []).append(lane)
    return (after if joints or len(known) < 2 else None), before, tiny


def _linked(element: Element, tag: str) -> list[int]:
    return [int(number(link, "id")) for link in element.findall(f"link/{tag}")]


def _through(road: DrawnRoad) -> Iterator[tuple[End, End]]:
    for k, (piece, following) in enumerate(pairwise(road.pieces)):
        pairs = [(i, i) for i in piece.lanes if piece.section == following.section]
        if piece.section != following.section:
            pairs += [(i, j) for i in piece.lanes for j in _linked(piece.elements[i], "successor")]
            pairs += [(i, j) for j in following.lanes for i in _linked(following.elements[j], "predecessor")]
        yield from ((((road.name, k, i), True), ((road.name, k + 1, j), False)) for i, j in pairs)


def _end(road: DrawnRoad, lane: int, *, at_end: bool) -> End:
    return (road.name, len(road.pieces) - 1 if at_end else 0, lane), at_end


def _onward(road: DrawnRoad, roads: Mapping[str, DrawnRoad]) -> Iterator[tuple[End, End]]:
    for tag, at_end in (("predecessor", False), ("successor", True)):
        link = road.element.find(f"link/{tag}")
        other = None if link is None else roads.get(link.get("elementId", ""))
        if link is None or other is None or link.get("elementType") == "junction":
            continue
        piece = road.pieces[-1 if at_end else 0]
        for i in piece.lanes:
            for j in _linked(piece.elements[i], tag):
                yield _end(road, i, at_end=at_end), _end(other, j, at_end=link.get("contactPoint") == "end")


def _connections(root: Element, roads: Mapping[str, DrawnRoad]) -> Iterator[tuple[End, End]]:
    for link in root.iterfind("junction/connection"):
        incoming = roads.get(link.get("incomingRoad", ""))
        other = roads.get(link.get("connectingRoad") or link.get("linkedRoad") or "")
        if incoming is None or other is None:
            continue
        contact = link.get("contactPoint") == "end"
        ends, place = incoming.line.places[[0, -1]], other.line.places[-1 if contact else 0]
        at_end = bool(np.argmin(np.hypot(*(ends - place).T)))
        for pair in link.findall("laneLink"):
            here, there = int(number(pair, "from")), int(number(pair, "to"))
            yield _end(incoming, here, at_end=at_end), _end(other, there, at_end=contact)


def _signals(drawn: OpenDriveMap, road: DrawnRoad, known: Mapping[str, Element], tiny: set[Name]) -> None:
    shown = [*road.element.findall("signals/signal"), *road.element.findall("signals/signalReference")]
    for element in shown:
        kind = known.get(element.get("id", ""), element).get("type", "").strip()
        if kind not in LIGHTS and kind not in SIGNS:
            continue
        s, side = number(element, "s"), element.get("orientation", "none")
        k = road.piece_at(s)
        valid = [sorted((number(x, "fromLane"), number(x, "toLane"))) for x in element.findall("validity")]
        for i in road.pieces[k].lanes:
            name = (road.name, k, i)
            faced = side == "none" or road.forward(k, i) == (side == "+")
            if name in tiny or not (any(a <= i <= b for a, b in valid) if valid else faced):
                continue
            if kind in SIGNS:
                drawn.stops.setdefault(name, SIGNS[kind])
            else:
                drawn.lit.setdefault(name, road.place(k, i, s))
                drawn.signals.setdefault(name, element.get("id", ""))


OPENDRIVE = MapFormat(is_mine=is_opendrive, read=read_opendrive, opendrive=unpacked)
