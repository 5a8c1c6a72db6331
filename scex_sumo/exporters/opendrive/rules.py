"""Rules of a road in OpenDRIVE: lights, signs, stop lines, crosswalks, priorities in junctions."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.network import Piece
from scex_sumo.road import Area, Lane, Regulation, Road

_STEP_M = 0.5  # between tried places of a signal
_FAR_M = 15.0  # from a crosswalk to the middle of its road
SIGNAL_HEIGHT_M = 2.5
_LIGHT = ("1000001", "OpenDRIVE")
_YIELD, _STOP, _STOP_LINE, _PRIORITY = ("205", "DE"), ("206", "DE"), ("294", "DE"), ("306", "DE")


def metres(value: float) -> str:
    """Return a length with at most four decimals."""
    return f"{value:.4f}".rstrip("0").rstrip(".")


def add(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Append an element, and return it; floats have ten digits."""
    values = attributes.items()
    texts = {key: f"{value:.10g}" if isinstance(value, float) else str(value) for key, value in values}
    return ET.SubElement(parent, tag, texts)


def priorities(road: Road, pieces: Sequence[Piece]) -> list[tuple[int, int, int]]:
    """Return junction, road with priority, and road that gives way, of the right of way inside junctions."""
    inside = {i: piece for piece in pieces if piece.junction is not None for i in piece.ribbon.group}
    rows = [
        (high.junction, high.number, low.number)
        for rule in road.regulations
        for first in rule.priority
        for second in rule.yielding
        if (high := inside.get(first)) and (low := inside.get(second)) and high.junction == low.junction
    ]
    return [(j, high, low) for j, high, low in dict.fromkeys(rows) if j is not None and high != low]


def placed_crosswalks(road: Road, pieces: Sequence[Piece]) -> dict[int, ET.Element]:
    """Return the ``objects`` of each road, by its number: crosswalks, each at the road that is nearest."""
    objects: dict[int, ET.Element] = {}
    driven = [p for p in pieces if any(i in road.vehicle_lanes for i in p.ribbon.group)]
    for area in road.areas if driven else ():
        if area.kind != "crosswalk":
            continue
        middle = shapely.Polygon(area.outline).centroid
        piece, s, gap = _nearest(driven, np.array([middle.x, middle.y]))
        if gap < _FAR_M:
            _add_crosswalk(objects.setdefault(piece.number, ET.Element("objects")), area, piece, s)
    return objects


def _add_crosswalk(objects: ET.Element, area: Area, piece: Piece, s: float) -> None:
    place, along = (rows[0] for rows in piece.ribbon.curve.at(np.array([s])))
    here = {"s": s, "t": 0, "zOffset": 0, "orientation": "none", "hdg": 0, "pitch": 0, "roll": 0}
    name = f"crosswalk {area.area_id}"
    element = add(objects, "object", type="crosswalk", id=area.area_id, name=name, **here)
    outline = add(add(element, "outlines"), "outline", id=0, closed="true", outer="true")
    for x, y in area.outline - place:
        u, v = x * along[0] + y * along[1], y * along[0] - x * along[1]
        add(outline, "cornerLocal", u=metres(u), v=metres(v), z=0, height=0)


class Signals(NamedTuple):
    """Lights, signs and stop lines, each at a place of a road.

    Attributes:
        of_roads: the element ``signals`` of roads, by number.
        lights: number and place (2,), m, of the traffic light of lanes.
    """

    of_roads: dict[int, ET.Element]
    lights: dict[int, tuple[str, FloatArray]]


def placed_signals(road: Road, pieces: Sequence[Piece]) -> Signals:
    """Return lights, signs and stop lines, at places of roads."""
    wanted = [(i, kind, rule) for rule in road.regulations for i, kind in _wanted(rule) if i in road.lanes]
    first = {(i, kind): rule for i, kind, rule in reversed(wanted)}
    order = dict.fromkeys((i, kind) for i, kind, _ in wanted)
    signals = Signals({}, {})
    for number, (i, kind) in enumerate(order, start=1):
        rule, dynamic = first[i, kind], "yes" if kind is _LIGHT else "no"
        piece, s = _where(pieces, road.lanes[i], rule)
        n = piece.ribbon.group.index(i)
        t = float(np.interp(s, piece.ribbon.s, piece.ribbon.offsets[:, n + 1]))
        here = {"s": s, "t": t, "id": number, "name": f"{rule.kind} {rule.element_id}", "dynamic": dynamic}
        size = {"subtype": -1, "height": 0.7, "width": 0.7}
        look = {"orientation": "+", "zOffset": SIGNAL_HEIGHT_M, "country": kind[1], "type": kind[0], **size}
        parent = signals.of_roads.setdefault(piece.number, ET.Element("signals"))
        add(add(parent, "signal", **here, **look), "validity", fromLane=-n - 1, toLane=-n - 1)
        if kind is _LIGHT:
            place, along = (rows[0] for rows in piece.ribbon.curve.at(np.array([s])))
            signals.lights.setdefault(i, (str(number), place + t * np.array([-along[1], along[0]])))
    return signals


def _wanted(rule: Regulation) -> list[tuple[int, tuple[str, str]]]:
    if rule.kind == "traffic_light":
        return _all(rule, rule.lanes, _LIGHT)
    if rule.kind in ("stop", "all_way_stop"):
        return _all(rule, rule.yielding or rule.lanes, _STOP)
    return _all(rule, rule.yielding, _YIELD) + [(i, _PRIORITY) for i in rule.priority]


def _all(rule: Regulation, lanes: Sequence[int], kind: tuple[str, str]) -> list[tuple[int, tuple[str, str]]]:
    signs = (kind, _STOP_LINE) if rule.stop_lines else (kind,)
    return [(i, sign) for i in lanes for sign in signs]


def _where(pieces: Sequence[Piece], lane: Lane, rule: Regulation) -> tuple[Piece, float]:
    line = shapely.LineString(lane.centreline)
    place = lane.centreline[-1]
    for points in rule.stop_lines:
        if len(points) > 1 and shapely.LineString(points).intersects(line):
            crossing = shapely.LineString(points).intersection(line).representative_point()
            place = np.array([crossing.x, crossing.y])
            break
    piece, s, _ = _nearest([piece for piece in pieces if lane.lane_id in piece.ribbon.group], place)
    return piece, s


def _nearest(pieces: Sequence[Piece], place: FloatArray) -> tuple[Piece, float, float]:
    """Return the road whose reference line is nearest to a place, s there, and the distance, m."""
    candidates = []
    for piece in pieces:
        s = np.linspace(0.0, piece.ribbon.length, max(2, round(piece.ribbon.length / _STEP_M)))
        gap = np.hypot(*(piece.ribbon.curve.at(s)[0] - place).T)
        candidates.append((piece, float(s[gap.argmin()]), float(gap.min())))
    return min(candidates, key=itemgetter(2))
