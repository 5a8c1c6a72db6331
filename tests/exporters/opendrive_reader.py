"""OpenDRIVE read independently of the writer: lane borders as points, links, junctions. For tests alone."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray

CODE = "scex_sumo_lane"


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadLane:
    """One lane of one section: its borders as points (N, 2), 0.1 m apart, in driving direction."""

    road: str
    number: int
    lane: int
    kind: str
    speed: float
    left: FloatArray
    right: FloatArray


class OpenDrive:
    def __init__(self, text: str) -> None:
        self.root = ET.fromstring(text.split("?>", 1)[1])
        self.roads = {road.get("id", ""): road for road in self.root.iter("road")}
        self.lanes = [lane for road in self.roads.values() for lane in _lanes(road)]

    def borders(self, lane: int) -> list[tuple[FloatArray, FloatArray]]:
        """Left and right border of the parts of a map's lane."""
        return [(part.left, part.right) for part in self.lanes if part.lane == lane]

    def successors(self) -> set[tuple[int, int]]:
        """Lanes of the map (from, to) that follow one another by the file's links."""
        found = set()
        for road in self.roads.values():
            sections = road.findall("lanes/laneSection")
            for k, section in enumerate(sections):
                for lane in section.findall("right/lane"):
                    for link in lane.findall("link/successor"):
                        if k + 1 < len(sections):
                            found |= _pair(lane, sections[k + 1], link.get("id", ""))
                    next_ = road.find("link/successor")
                    if k + 1 == len(sections) and next_ is not None and next_.get("elementType") == "road":
                        other = self.roads[next_.get("elementId", "")].findall("lanes/laneSection")[0]
                        for link in lane.findall("link/successor"):
                            found |= _pair(lane, other, link.get("id", ""))
        for connection in self.root.iter("connection"):
            before = self.roads[connection.get("incomingRoad", "")].findall("lanes/laneSection")[-1]
            after = self.roads[connection.get("connectingRoad", "")].findall("lanes/laneSection")[0]
            for link in connection.findall("laneLink"):
                (lane,) = [x for x in before.findall("right/lane") if x.get("id") == link.get("from")]
                found |= _pair(lane, after, link.get("to", ""))
        return {(a, b) for a, b in found if a != b}


def _pair(lane: ET.Element, section: ET.Element, number: str) -> set[tuple[int, int]]:
    return {
        (_id(lane), _id(other)) for other in section.findall("right/lane") if other.get("id") == number
    } or {(_id(lane), -1)}


def _id(lane: ET.Element) -> int:
    (data,) = [data for data in lane.findall("userData") if data.get("code") == CODE]
    return int(data.get("value", ""))


def _numbers(element: ET.Element, *names: str) -> list[float]:
    return [float(element.get(name, "nan")) for name in names]


def _polynomials(elements: list[ET.Element], at: str) -> FloatArray:
    """(N, 5) beginning and coefficients, ascending."""
    return np.array(sorted(_numbers(e, at, "a", "b", "c", "d") for e in elements)).reshape(-1, 5)


def _value(table: FloatArray, s: FloatArray) -> FloatArray:
    if not len(table):
        return np.zeros_like(s)
    row = table[np.clip(np.searchsorted(table[:, 0], s + 1e-9, side="right") - 1, 0, None)]
    ds = s - row[:, 0]
    return row[:, 1] + row[:, 2] * ds + row[:, 3] * ds**2 + row[:, 4] * ds**3


def reference(road: ET.Element, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and headings of the reference line, (N, 2) and (N,)."""
    points, headings = np.full((len(s), 2), np.nan), np.full(len(s), np.nan)
    pieces = road.findall("planView/geometry")
    starts = np.array([float(piece.get("s", "nan")) for piece in pieces])
    which = np.clip(np.searchsorted(starts, s + 1e-9, side="right") - 1, 0, None)
    for k, piece in enumerate(pieces):
        x, y, heading = _numbers(piece, "x", "y", "hdg")
        cubic = piece.find("paramPoly3")
        assert cubic is not None and cubic.get("pRange") == "arcLength"
        mine = which == k
        p = s[mine] - starts[k]
        u, v = (_numbers(cubic, *(c + axis for c in "abcd")) for axis in "UV")
        powers = np.stack([np.ones_like(p), p, p**2, p**3])
        slopes = np.stack([np.zeros_like(p), np.ones_like(p), 2 * p, 3 * p**2])
        c, si = np.cos(heading), np.sin(heading)
        du, dv = np.array(u) @ powers, np.array(v) @ powers
        points[mine] = np.stack([x + c * du - si * dv, y + si * du + c * dv], axis=1)
        headings[mine] = heading + np.arctan2(np.array(v) @ slopes, np.array(u) @ slopes)
    return points, headings


def _lanes(road: ET.Element) -> list[ReadLane]:
    length = float(road.get("length", "nan"))
    sections = road.findall("lanes/laneSection")
    begins = [float(section.get("s", "nan")) for section in sections]
    shift = _polynomials(road.findall("lanes/laneOffset"), "s")
    result = []
    for section, start, end in zip(sections, begins, [*begins[1:], length], strict=True):
        s = np.linspace(start, end, max(3, int(np.ceil((end - start) / 0.1)) + 1))
        place, heading = reference(road, s)
        normal = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        offset = _value(shift, s)
        for lane in sorted(section.findall("right/lane"), key=lambda x: -int(x.get("id", ""))):
            width = _value(_polynomials(lane.findall("width"), "sOffset"), s - start)
            speed = lane.find("speed")
            assert speed is not None
            result.append(
                ReadLane(
                    road=road.get("id", ""),
                    number=int(lane.get("id", "")),
                    lane=_id(lane),
                    kind=lane.get("type", ""),
                    speed=float(speed.get("max", "nan")),
                    left=place + offset[:, None] * normal,
                    right=place + (offset - width)[:, None] * normal,
                )
            )
            offset = offset - width
    return result
