"""Rules of a road in OpenDRIVE: lights, signs, stop lines, crosswalks, priorities in junctions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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


def exact(value: float) -> str:
    """Return a number with ten digits."""
    return f"{value:.10g}"


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


def placed_crosswalks(road: Road, pieces: Sequence[Piece]) -> dict[int, list[ET.Element]]:
    """Return the crosswalks of each road, by its number: an outline at the road that is nearest."""
    objects: dict[int, list[ET.Element]] = {}
    driven = [p for p in pieces if any(i in road.vehicle_lanes for i in p.ribbon.group)]
    for area in road.areas if driven else ():
        if area.kind != "crosswalk":
            continue
        middle = shapely.Polygon(area.outline).centroid
        piece, s, gap = _nearest(driven, np.array([middle.x, middle.y]))
        if gap < _FAR_M:
            objects.setdefault(piece.number, []).append(_crosswalk(area, piece, s))
    return objects


def _crosswalk(area: Area, piece: Piece, s: float) -> ET.Element:
    place, along = (rows[0] for rows in piece.ribbon.curve.at(np.array([s])))
    element = ET.Element(
        "object",
        type="crosswalk",
        id=str(area.area_id),
        name=f"crosswalk {area.area_id}",
        s=exact(s),
        t="0",
        zOffset="0",
        orientation="none",
        hdg="0",
        pitch="0",
        roll="0",
    )
    outlines = ET.SubElement(element, "outlines")
    outline = ET.SubElement(outlines, "outline", id="0", closed="true", outer="true")
    for x, y in area.outline - place:
        u, v = x * along[0] + y * along[1], y * along[0] - x * along[1]
        ET.SubElement(outline, "cornerLocal", u=metres(u), v=metres(v), z="0", height="0")
    return element


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """Light, sign or stop line of a lane, at a place of a road.

    Attributes:
        road: number of the road; its element has the number of the signal.
        place: (2,) m.
    """

    lane: int
    road: int
    element: ET.Element
    place: FloatArray

    @property
    def is_light(self) -> bool:
        """Whether it is a traffic light."""
        return self.element.get("dynamic") == "yes"


def placed_signals(road: Road, pieces: Sequence[Piece]) -> list[Signal]:
    """Return lights, signs and stop lines."""
    wanted = [(*one, rule) for rule in road.regulations for one in _wanted(rule) if one[0] in road.lanes]
    first = {(i, kind): rule for i, kind, rule in reversed(wanted)}
    order = dict.fromkeys((i, kind) for i, kind, _ in wanted)
    return [_signal(pieces, road.lanes[i], kind, first[i, kind], n + 1) for n, (i, kind) in enumerate(order)]


def _signal(
    pieces: Sequence[Piece], lane: Lane, kind: tuple[str, str], rule: Regulation, number: int
) -> Signal:
    piece, s = _where(pieces, lane, rule)
    n = piece.ribbon.group.index(lane.lane_id)
    t = float(np.interp(s, piece.ribbon.s, piece.ribbon.offsets[:, n + 1]))
    signal = ET.Element(
        "signal",
        s=exact(s),
        t=exact(t),
        id=str(number),
        name=f"{rule.kind} {rule.element_id}",
        dynamic="yes" if kind is _LIGHT else "no",
        orientation="+",
        zOffset=str(SIGNAL_HEIGHT_M),
        country=kind[1],
        type=kind[0],
        subtype="-1",
        height="0.7",
        width="0.7",
    )
    ET.SubElement(signal, "validity", fromLane=str(-n - 1), toLane=str(-n - 1))
    place, along = (rows[0] for rows in piece.ribbon.curve.at(np.array([s])))
    across = np.array([-along[1], along[0]])
    return Signal(lane=lane.lane_id, road=piece.number, element=signal, place=place + t * across)


def _wanted(rule: Regulation) -> list[tuple[int, tuple[str, str]]]:
    if rule.kind == "traffic_light":
        return _all(rule, rule.lanes, _LIGHT)
    if rule.kind in ("stop", "all_way_stop"):
        return _all(rule, rule.yielding or rule.lanes, _STOP)
    return _all(rule, rule.yielding, _YIELD) + [(i, _PRIORITY) for i in rule.priority]


def _all(rule: Regulation, lanes: Sequence[int], kind: tuple[str, str]) -> list[tuple[int, tuple[str, str]]]:
    kinds = (kind, _STOP_LINE) if rule.stop_lines else (kind,)
    return [(i, one) for i in lanes for one in kinds]


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
    return min(candidates, key=lambda one: one[2])
