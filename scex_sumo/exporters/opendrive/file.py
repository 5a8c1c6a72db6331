"""OpenDRIVE of a run: the file that its map came from, else one of version 1.7, of its road and rules."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.version import __version__
from scex_sumo.converters.lanelet.projection import to_local, utm_zone
from scex_sumo.converters.net.sumo_net import OPENDRIVE, net_file
from scex_sumo.converters.xml import xml_root
from scex_sumo.exporters.light_cycles import with_lights
from scex_sumo.exporters.opendrive.network import Piece, connections, road_network
from scex_sumo.exporters.opendrive.reference import Curve
from scex_sumo.exporters.opendrive.rules import add, metres, placed_crosswalks, placed_signals, priorities
from scex_sumo.exporters.request import Request
from scex_sumo.formats.opendrive.lanes import opendrive_map
from scex_sumo.road import Lane, Road

LANE_CODE = "scex_sumo_lane"  # user data of a lane: its id in the map
_TYPES = {"vehicle": "driving", "bus": "bus", "bicycle": "biking", "pedestrian": "sidewalk"}
_MARK_M = 0.12


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenDrive:
    """Map as OpenDRIVE, and what it holds of a road's lanes.

    Attributes:
        projection: PROJ's description of its coordinates; empty if unknown.
        offset: x, y, z and heading of its coordinates in those of the projection.
        places: road, station of the section and lane number of lanes, as text.
        inside: lanes within junctions.
        lights: number and place (2,) of the traffic light of lanes; a place may be unknown.
        flat: whether its heights are 0.
    """

    text: str
    projection: str = ""
    offset: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    places: Mapping[int, tuple[str, str, str]] = field(default_factory=dict)
    inside: frozenset[int] = frozenset()
    lights: Mapping[int, tuple[str, FloatArray | None]] = field(default_factory=dict)
    flat: bool = True


def opendrive_of(request: Request) -> OpenDrive:
    """Return the map of a run as OpenDRIVE.

    A map that came as OpenDRIVE stays as it is, with its widths and heights. Lights that only the run knows
    join a map that is written.
    """
    given = net_file(request.run.net.path, OPENDRIVE)
    if given.is_file():
        return _as_given(given)
    return opendrive(with_lights(request.road, request.run.net))


def _as_given(file: Path) -> OpenDrive:
    content = file.read_bytes()
    root = xml_root(file, content)
    offset = root.find("header/offset")
    names = ("x", "y", "z", "hdg")
    x, y, z, heading = (float("0" if offset is None else offset.get(name, "0")) for name in names)
    drawn = opendrive_map(file, root)
    ids = drawn.lane_ids()
    return OpenDrive(
        text=content.decode(errors="replace"),
        projection=(root.findtext("header/geoReference") or "").strip(),
        offset=(x, y, z, heading),
        inside=frozenset(ids[lane.name] for lane in drawn.lanes if lane.inside),
        lights={ids[lane]: (signal, None) for lane, signal in drawn.signals.items()},
        flat=not any(float(rise.get(name, "0")) for rise in root.iter("elevation") for name in "abcd"),
    )


def opendrive(road: Road) -> OpenDrive:
    """Return a road as OpenDRIVE in its own coordinates, m.

    Lanes have the map's lane as user data; the header has the place on Earth if known.
    """
    pieces = road_network(road.lanes)
    root = ET.Element("OpenDRIVE")
    _add_header(root, road)
    objects, signals = placed_crosswalks(road, pieces), placed_signals(road, pieces)
    for piece in pieces:
        element = _add_road(root, piece, road.lanes)
        for elements in (objects, signals.of_roads):
            if piece.number in elements:
                element.append(elements[piece.number])
    _add_junctions(root, pieces, priorities(road, pieces))
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=False)
    return OpenDrive(
        text=text.join(('<?xml version="1.0" encoding="UTF-8"?>\n', "\n")),
        projection=projection_text(road.origin) if road.origin != (0.0, 0.0) else "",
        places={
            i: (str(piece.number), "0", str(-n - 1))
            for piece in reversed(pieces)
            for n, i in enumerate(piece.ribbon.group)
        },
        inside=frozenset(i for piece in pieces if piece.junction is not None for i in piece.ribbon.group),
        lights=signals.lights,
    )


def _add_header(root: ET.Element, road: Road) -> None:
    places = np.vstack([line for lane in road.lanes.values() for line in (lane.left_bound, lane.right_bound)])
    west, south = places.min(axis=0)
    east, north = places.max(axis=0)
    box = {"north": metres(north), "south": metres(south), "east": metres(east), "west": metres(west)}
    about = {"revMajor": 1, "revMinor": 7, "name": road.name, "version": "1.00", **box}
    header = add(root, "header", **about, vendor=f"scex-sumo {__version__}")
    if road.origin != (0.0, 0.0):
        add(header, "geoReference").text = projection_text(road.origin)


def projection_text(origin: tuple[float, float]) -> str:
    """Return PROJ's description of coordinates relative to an origin in its UTM zone."""
    meridian = 6.0 * utm_zone(*origin) - 183.0
    x, y = to_local(np.array([origin]), (0.0, meridian))[0]
    return (
        f"+proj=tmerc +lat_0=0 +lon_0={meridian:g} +k=0.9996 +x_0={-x:.4f} +y_0={-y:.4f} "
        "+datum=WGS84 +units=m +no_defs"
    )


def _add_road(root: ET.Element, piece: Piece, lanes: Mapping[int, Lane]) -> ET.Element:
    members = piece.ribbon.group
    about = {"name": " ".join(map(str, members)), "length": piece.ribbon.length, "id": piece.number}
    road = add(root, "road", **about, junction=-1 if piece.junction is None else piece.junction, rule="RHT")
    link = add(road, "link")
    for tag, other, contact in (("predecessor", piece.before, "end"), ("successor", piece.after, "start")):
        if other is not None and other.junction is not None:
            add(link, tag, elementType="junction", elementId=other.junction)
        elif other is not None:
            add(link, tag, elementType="road", elementId=other.road, contactPoint=contact)
    fastest = max(lanes[i].speed_limit_mps for i in members)
    kind = "rural" if lanes[members[0]].location == "nonurban" else "town"
    add(add(road, "type", s=0, type=kind), "speed", max=metres(fastest), unit="m/s")
    _plan_view(add(road, "planView"), piece.ribbon.curve)
    add(add(road, "elevationProfile"), "elevation", s=0, a=0, b=0, c=0, d=0)
    _lanes(add(road, "lanes"), piece, lanes)
    return road


def _plan_view(view: ET.Element, curve: Curve) -> None:
    headings = np.arctan2(curve.tangents[:, 1], curve.tangents[:, 0])
    for k, size in enumerate(np.diff(curve.s)):
        c, s = curve.tangents[k]
        turn = np.array([[c, s], [-s, c]])
        end, slope = turn @ (curve.points[k + 1] - curve.points[k]), turn @ curve.tangents[k + 1]
        start = np.array([1.0, 0.0])
        square = (3 * end / size - 2 * start - slope) / size
        cube = (start + slope - 2 * end / size) / size**2
        x, y = curve.points[k]
        geometry = add(view, "geometry", s=curve.s[k], x=x, y=y, hdg=headings[k], length=size)
        powers = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": square, "d": cube}
        cubic = {f"{power}{axis}": v[n] for n, axis in enumerate("UV") for power, v in powers.items()}
        add(geometry, "paramPoly3", **cubic, pRange="arcLength")


def _lanes(element: ET.Element, piece: Piece, lanes: Mapping[int, Lane]) -> None:
    ribbon = piece.ribbon
    _lines(element, "laneOffset", ribbon.s, ribbon.offsets[:, 0], "s")
    section = add(element, "laneSection", s=0)
    middle = add(add(section, "center"), "lane", id=0, type="none", level="false")
    add(middle, "link")
    _mark(middle, crossed=False)
    right = add(section, "right")
    for n, i in enumerate(ribbon.group):
        _add_lane(right, piece, n, lanes[i])


def _add_lane(right: ET.Element, piece: Piece, n: int, lane: Lane) -> None:
    element = add(right, "lane", id=-n - 1, type=_TYPES.get(lane.kind, "none"), level="false")
    link, ribbon = add(element, "link"), piece.ribbon
    for tag, road in (("predecessor", piece.before), ("successor", piece.after)):
        for this, other in () if road is None else road.lanes:
            if this == -n - 1:
                add(link, tag, id=other)
    _lines(element, "width", ribbon.s, ribbon.offsets[:, n] - ribbon.offsets[:, n + 1], "sOffset")
    _mark(element, crossed=lane.right is not None and n + 1 < len(ribbon.group))
    add(element, "speed", sOffset=0, max=metres(lane.speed_limit_mps), unit="m/s")
    add(element, "userData", code=LANE_CODE, value=lane.lane_id)


def _lines(parent: ET.Element, tag: str, s: FloatArray, values: FloatArray, station: str) -> None:
    slope = np.diff(values) / np.diff(s)
    written: tuple[float, float, float] | None = None
    for start, value, rise in zip(s[:-1], values[:-1], slope, strict=True):
        if written is not None:
            expected = written[1] + written[2] * (start - written[0])
            if abs(expected - value) < 1e-5 and abs(written[2] - rise) < 1e-6:
                continue
        written = (start, value, rise)
        add(parent, tag, **{station: start, "a": value, "b": rise}, c=0, d=0)


def _mark(lane: ET.Element, *, crossed: bool) -> None:
    kind, change = ("broken", "both") if crossed else ("solid", "none")
    look = dict.fromkeys(("weight", "color", "material"), "standard")
    add(lane, "roadMark", sOffset=0, type=kind, **look, width=_MARK_M, laneChange=change)


def _add_junctions(root: ET.Element, pieces: Sequence[Piece], first: Iterable[tuple[int, int, int]]) -> None:
    junctions: dict[int, ET.Element] = {}
    for number, incoming, connecting in connections(pieces):
        if number not in junctions:
            junctions[number] = add(root, "junction", name=f"junction {number}", id=number, type="default")
        roads = {"incomingRoad": incoming.number, "connectingRoad": connecting.number}
        junction = junctions[number]
        connection = add(junction, "connection", id=len(junction), **roads, contactPoint="start")
        assert connecting.before is not None
        for lane, other in connecting.before.lanes:
            add(connection, "laneLink", **{"from": other, "to": lane})
    for number, high, low in first:
        if number in junctions:
            add(junctions[number], "priority", high=high, low=low)
