"""OpenDRIVE file that netconvert would fail at: repaired, or refused in words about the file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from scex_sumo.base.errors import MapError, listed

MAX_LENGTH_M = 1e6  # of a road: longer ones cost netconvert all memory
MIN_LENGTH_M = 1e-6  # of a polynomial: shorter ones too
FLAT_M = 1e-3  # change of curvature times squared length, below which netconvert fails at spirals
JOINT_M = 0.05  # of the connecting roads that direct junctions lack


def repaired_opendrive(path: Path, content: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return a file as netconvert can read it, with a note for each kind of repair; without any as it was.

    Raises:
        MapError: it is not XML, a number is not finite, a road is too long, or no road is whole.
    """
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise MapError(f"{path}: not XML ({error}); export it again") from None
    notes = [*_without_typeless_signals(root)]
    for road in root.iter("road"):
        _check_numbers(path, road)
    notes += [*_simpler_geometry(root), *_without_empty_roads(path, root), *_ordinary_junctions(root)]
    return (ElementTree.tostring(root, encoding="utf-8"), tuple(notes)) if notes else (content, ())


def _without_typeless_signals(root: Element) -> Iterator[str]:
    left_out = []
    for signals in root.iter("signals"):
        for signal in [x for x in signals.iter("signal") if not x.get("type", "").strip()]:
            signals.remove(signal)
            left_out.append(signal.get("id", "?"))
    if left_out:
        yield f"signals without a type left out: {listed(left_out)}"


def _check_numbers(path: Path, road: Element) -> None:
    for element in (road, *(part for geometry in road.iter("geometry") for part in geometry.iter())):
        for name, text in element.items():
            if name == "pRange" or (element is road and name != "length"):
                continue
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            largest = MAX_LENGTH_M if name == "length" else math.inf
            if not (math.isfinite(value) and abs(value) <= largest):
                where = f"{path}: road {road.get('id')}: {name} of its {element.tag} is {text[:24]!r}"
                raise MapError(f"{where}; repair the file or leave the road out")


def _simpler_geometry(root: Element) -> Iterator[str]:
    plain, empty = [], []
    for road in root.iter("road"):
        for view in road.iter("planView"):
            for stretch in view.findall("geometry"):
                if _plain(stretch):
                    plain.append(road.get("id", "?"))
                polynomial = stretch.find("paramPoly3") is not None or stretch.find("poly3") is not None
                if polynomial and abs(_number(stretch, "length")) < MIN_LENGTH_M:
                    view.remove(stretch)
                    empty.append(road.get("id", "?"))
    if plain:
        yield f"arcs that are lines, and spirals that are arcs or lines: roads {listed(dict.fromkeys(plain))}"
    if empty:
        yield f"polynomials without length left out: roads {listed(dict.fromkeys(empty))}"


def _plain(stretch: Element) -> bool:
    """Make an arc that hardly bends a line, and a spiral of nearly one curvature an arc or a line."""
    old = next((shape for shape in stretch if shape.tag in ("arc", "spiral")), None)
    if old is None:
        return False
    first, last = _curvatures(stretch)
    least = FLAT_M / max(_number(stretch, "length"), MIN_LENGTH_M) ** 2
    straight = max(abs(first), abs(last)) <= least
    if not straight and (old.tag == "arc" or abs(last - first) > least):
        return False
    stretch.remove(old)
    bent = {} if straight else {"curvature": repr((first + last) / 2)}
    SubElement(stretch, "arc" if bent else "line", bent)
    return True


def _curvatures(stretch: Element) -> tuple[float, float]:
    """Return the curvatures at both ends of a line, an arc or a spiral."""
    if (arc := stretch.find("arc")) is not None:
        return _number(arc, "curvature"), _number(arc, "curvature")
    spiral = stretch.find("spiral")
    return (0.0, 0.0) if spiral is None else (_number(spiral, "curvStart"), _number(spiral, "curvEnd"))


def _without_empty_roads(path: Path, root: Element) -> Iterator[str]:
    left_out = []
    for road in root.findall("road"):
        if road.find("planView/geometry/*") is None or road.find("lanes/laneSection") is None:
            root.remove(road)
            left_out.append(road.get("id", "?"))
    if left_out and root.find("road") is None:
        raise MapError(f"{path}: none of its {len(left_out)} roads has geometry and lanes; export it again")
    for junction in root.iter("junction"):
        for connection in junction.findall("connection"):
            kinds = ("incoming", "connecting", "linked")
            if any(connection.get(f"{kind}Road") in left_out for kind in kinds):
                junction.remove(connection)
    if left_out:
        yield f"roads without geometry or lanes left out: {listed(left_out)}"


def _number(element: Element, name: str) -> float:
    return float(element.get(name, "0"))


def _ordinary_junctions(root: Element) -> Iterator[str]:
    """Give direct junctions connecting roads of `JOINT_M`, one for each pair of linked lanes."""
    roads = {road.get("id", ""): road for road in root.findall("road")}
    numbers = iter(range(max([10**6, *(int(i) + 1 for i in roads if i.isdigit())]), 2**31))
    changed = []
    for junction in root.findall("junction"):
        if junction.get("type") != "direct":
            continue
        changed.append(junction.get("id", "?"))
        junction.set("type", "default")
        for old in junction.findall("connection"):
            junction.remove(old)
            incoming, linked = (roads.get(old.get(name, "")) for name in ("incomingRoad", "linkedRoad"))
            if incoming is None or linked is None:
                continue
            contact = old.get("contactPoint", "start")
            touching = _touching_end(incoming, linked, junction.get("id", ""))
            _leave(incoming, touching, junction)
            _leave(linked, contact, junction)
            for link in old.findall("laneLink"):
                here, there = int(link.get("from", "0")), int(link.get("to", "0"))
                ways = (incoming, touching, here), (linked, contact, there)
                if (here < 0) != (touching == "end"):  # traffic comes out of the linked road
                    ways = ways[::-1]
                root.append(_joint(next(numbers), junction, *ways))
    if changed:
        yield f"direct junctions made ordinary ones: {listed(changed)}"


def _touching_end(road: Element, linked: Element, junction: str) -> str:
    for tag, end in (("successor", "end"), ("predecessor", "start")):
        link = road.find(f"link/{tag}")
        if link is not None and (
            (link.get("elementType") == "junction" and link.get("elementId") == junction)
            or (link.get("elementType") == "road" and link.get("elementId") == linked.get("id"))
        ):
            return end
    return "end"


def _leave(road: Element, end: str, junction: Element) -> None:
    """Link an end of a road to the junction, and its lanes to nothing there."""
    tag = "successor" if end == "end" else "predecessor"
    links = road.find("link")
    links = SubElement(road, "link") if links is None else links
    for old in links.findall(tag):
        links.remove(old)
    SubElement(links, tag, elementType="junction", elementId=junction.get("id", ""))
    for lane in _section(road, end).iter("lane"):
        for of_lane in lane.findall("link"):
            for old in of_lane.findall(tag):
                of_lane.remove(old)


def _joint(
    number: int, junction: Element, before: tuple[Element, str, int], after: tuple[Element, str, int]
) -> Element:
    """Return the connecting road of one lane, and add its connection to the junction."""
    (start, end, lane), (next_road, contact, next_lane) = before, after
    x, y, heading = _pose(start, end)
    left, width = _lane_place(start, end, lane)
    road = Element("road", name="", id=str(number), length=repr(JOINT_M), junction=junction.get("id", ""))
    links = SubElement(road, "link")
    for tag, other, at in (("predecessor", start, end), ("successor", next_road, contact)):
        SubElement(links, tag, elementType="road", elementId=other.get("id", ""), contactPoint=at)
    view = SubElement(road, "planView")
    place = {"s": 0.0, "x": x, "y": y, "hdg": heading, "length": JOINT_M}
    geometry = SubElement(view, "geometry", {name: repr(float(value)) for name, value in place.items()})
    SubElement(geometry, "line")
    lanes = SubElement(road, "lanes")
    SubElement(lanes, "laneOffset", s="0", a=repr(left), b="0", c="0", d="0")
    section = SubElement(lanes, "laneSection", s="0")
    SubElement(SubElement(section, "center"), "lane", id="0", type="none", level="false")
    element = SubElement(SubElement(section, "right"), "lane", id="-1", type="driving", level="false")
    link = SubElement(element, "link")
    SubElement(link, "predecessor", id=str(lane))
    SubElement(link, "successor", id=str(next_lane))
    SubElement(element, "width", sOffset="0", a=repr(width), b="0", c="0", d="0")
    connection = SubElement(
        junction,
        "connection",
        id=str(number),
        incomingRoad=start.get("id", ""),
        connectingRoad=str(number),
        contactPoint="start",
    )
    SubElement(connection, "laneLink", {"from": str(lane), "to": "-1"})
    return road


def _section(road: Element, end: str) -> Element:
    sections = sorted(road.findall("lanes/laneSection"), key=lambda section: _number(section, "s"))
    return sections[-1 if end == "end" else 0]


def _lane_place(road: Element, end: str, lane: int) -> tuple[float, float]:
    """Return how far a lane's left border is left of the reference line, seen as driven, and its width."""
    s = _number(road, "length") if end == "end" else 0.0
    section = _section(road, end)
    offset = _polynomial(road.findall("lanes/laneOffset"), "s", s)
    side = -1 if lane < 0 else 1
    widths = {
        abs(int(x.get("id", "0"))): _polynomial(x.findall("width"), "sOffset", s - _number(section, "s"))
        for x in section.iter("lane")
        if int(x.get("id", "0")) * side > 0
    }
    inner = sum(width for k, width in widths.items() if k < abs(lane))
    return -side * offset - inner, widths.get(abs(lane), 3.0)


def _polynomial(records: list[Element], at: str, s: float) -> float:
    known = [record for record in records if _number(record, at) <= s + MIN_LENGTH_M]
    if not known:
        return 0.0
    record = max(known, key=lambda record: _number(record, at))
    return _evaluated([_number(record, name) for name in "abcd"], s - _number(record, at))


def _evaluated(cubic: list[float], u: float) -> float:
    a, b, c, d = cubic
    return a + u * (b + u * (c + u * d))


def _pose(road: Element, end: str) -> tuple[float, float, float]:
    """Return the reference line's place at an end of a road, and the direction out of the road there."""
    stretches = sorted(road.findall("planView/geometry"), key=lambda stretch: _number(stretch, "s"))
    stretch = stretches[-1 if end == "end" else 0]
    x, y, heading = (_number(stretch, name) for name in ("x", "y", "hdg"))
    if end == "start":
        return x, y, heading + math.pi
    u, v, turn = _along(stretch, _number(stretch, "length"))
    cos, sin = math.cos(heading), math.sin(heading)
    return x + cos * u - sin * v, y + sin * u + cos * v, heading + turn


def _along(stretch: Element, length: float) -> tuple[float, float, float]:
    """Return u, v and the direction at the end of a stretch, in the frame of its beginning."""
    if (cubic := stretch.find("paramPoly3")) is not None:
        p = length if cubic.get("pRange") == "arcLength" else 1.0
        across, ahead = ([_number(cubic, f"{k}{axis}") for k in "abcd"] for axis in "VU")
        slopes = [b + p * (2 * c + p * 3 * d) for _, b, c, d in (across, ahead)]
        return _evaluated(ahead, p), _evaluated(across, p), math.atan2(*slopes)
    if (poly := stretch.find("poly3")) is not None:
        _, b, c, d = across = [_number(poly, k) for k in "abcd"]
        return length, _evaluated(across, length), math.atan(b + length * (2 * c + length * 3 * d))
    first, last = _curvatures(stretch)
    s = (np.arange(1000) + 0.5) / 1000 * length
    turned = first * s + (last - first) * s**2 / (2 * length)
    steps = length / 1000 * np.stack((np.cos(turned), np.sin(turned)), axis=1)
    u, v = steps.sum(axis=0).tolist()
    return u, v, (first + last) / 2 * length
