"""Reader of CommonRoad maps: lanes, regulations and lines by types, road users, markings and signs."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.tags import LEFT_HAND, drives_left_at
from scex_sumo.converters.naming import map_name, number
from scex_sumo.converters.registries import MapFormat
from scex_sumo.formats.commonroad.file import (
    CommonRoadFile,
    Sign,
    bounds_of,
    element_id,
    library,
    parse_commonroad,
    points_of,
    signs_of,
)
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, drawn_road
from scex_sumo.formats.recognition import is_commonroad
from scex_sumo.geometry.bounds import bounds_cross
from scex_sumo.geometry.polylines import without_repeats
from scex_sumo.road import Area, Lane, Regulation, Road

CARS = {"vehicle", "car"}
_LINKS = ("successor", "predecessor", "adjacentLeft", "adjacentRight")
# In order of precedence.
_KINDS = {
    "crosswalk": "pedestrian",
    "sidewalk": "pedestrian",
    "bicycleLane": "bicycle",
    "busLane": "bus",
    "busStop": "bus",
    "restricted": "bus",
}
_NEVER_DRIVEN = {"border", "parking", "restricted_area", "shoulder"}
_SUBTYPES = {
    "crosswalk": "crosswalk",
    "sidewalk": "walkway",
    "bicycleLane": "bicycle_lane",
    "busLane": "bus_lane",
    "restricted": "bus_lane",
    "parking": "parking",
    "restricted_area": "keepout",
    "shoulder": "emergency_lane",
    "highway": "highway",
    "interstate": "highway",
}
_NO_CROSSING = {"solid", "broad_solid", "solid_solid", "curb", "lowered_curb"}
# Lanelet2's type and subtype of the markings that are drawn.
LINES = {
    "dashed": ("line_thin", "dashed"),
    "solid": ("line_thin", "solid"),
    "broad_dashed": ("line_thick", "dashed"),
    "broad_solid": ("line_thick", "solid"),
    "solid_solid": ("line_thin", "solid_solid"),
    "dashed_dashed": ("line_thin", "dashed"),
    "solid_dashed": ("line_thin", "solid_dashed"),
    "dashed_solid": ("line_thin", "dashed_solid"),
    "curb": ("curbstone", "high"),
    "lowered_curb": ("curbstone", "low"),
}
_SIGN_KINDS = {"YIELD": "yield", "STOP": "stop", "STOP_4_WAY": "all_way_stop"}
_PRIORITY_SIGNS = {"PRIORITY", "RIGHT_OF_WAY"}
_SPEED_SIGNS = ("MAX_SPEED", "MAX_SPEED_ZONE_START")
MAX_LIMIT_MPS = 70.0  # no limit is above 250 km/h; greater numbers are km/h by mistake


def kind_by_types(types: frozenset[str], users: set[str]) -> str:
    """Kind of a lane: ``vehicle``, ``bus``, ``bicycle``, ``pedestrian`` or ``other``."""
    if types & _NEVER_DRIVEN:
        return "other"
    if users & CARS:
        return "vehicle"
    by_type = next((kind for name, kind in _KINDS.items() if name in types), None)
    if by_type is not None:
        return by_type
    if not users:
        return "vehicle"
    return next((kind for kind in ("bus", "bicycle", "pedestrian") if kind in users), "other")


Signs: TypeAlias = Mapping[int, tuple[Sign, ...]]
Words: TypeAlias = Mapping[str, set[str]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanelet(DrawnLane):
    """Lanelet with its signs and lights by id, and its stop line, (2, 2) ends in m.

    Attributes:
        markings: of its left and right bound: ``solid``, ``dashed``, ...
        both_ways: cars may use it in both directions.
    """

    markings: tuple[str, ...]
    both_ways: bool
    signs: frozenset[int]
    lights: frozenset[int]
    stop_line: FloatArray | None


Lanelets: TypeAlias = Mapping[int, Lanelet]


def read_lanelets(file: CommonRoadFile, words: Words, signs: Signs) -> dict[int, Lanelet]:
    """Read usable lanelets by ascending id; ``words``: words of CommonRoad by tag.

    Defects of the others go into the file's notes.
    """
    usable: dict[int, tuple[Element, FloatArray, FloatArray]] = {}
    for xml in file.root.findall("lanelet"):
        i = element_id(xml)
        if i is None:
            file.note("lanelets left out, their id is no positive number", xml.get("id", "")[:24] or "none")
        elif i in usable:
            file.note("ids used twice, the first lanelet kept", i)
        elif (bounds := bounds_of(xml, i, file)) is not None:
            usable[i] = (xml, *bounds)
    lights = file.elements("trafficLight").keys()
    known = {"trafficSignRef": signs.keys(), "trafficLightRef": lights} | dict.fromkeys(_LINKS, usable.keys())
    return {i: _Reader(file, i, known, words).lanelet(*parts, signs) for i, parts in sorted(usable.items())}


class _Reader:
    """Reader of one lanelet; what the file does not have, or CommonRoad, is left out and noted."""

    def __init__(
        self, file: CommonRoadFile, i: int, known: Mapping[str, Collection[int]], words: Words
    ) -> None:
        self._file, self._id, self._known, self._words = file, i, known, words

    def lanelet(self, xml: Element, left: FloatArray, right: FloatArray, signs: Signs) -> Lanelet:
        if bounds_cross(left[:, :2], right[:, :2]):
            self._file.note("bounds cross each other or themselves, the lane's shape may be off", self._id)
        types = frozenset(self._said("laneletType", xml))
        users, both_ways = (self._said(tag, xml) for tag in ("userOneWay", "userBidirectional"))
        stop_line, line = next(self._stop_lines(xml, left, right), (None, None))
        parents = [xml] if line is None else [xml, line]
        texts = [self._said("lineMarking", xml.find(name)) for name in ("leftBound", "rightBound")]
        markings = tuple(next(iter(words), "unknown") for words in texts)
        ours = frozenset(ref for parent in parents for ref in self._refs("trafficSignRef", parent))
        return Lanelet(
            name=self._id,
            centre=0.5 * (left + right) if len(left) == len(right) else None,
            left=left,
            right=right,
            kind=kind_by_types(types, {*users, *both_ways}),
            subtype=next((word for name, word in _SUBTYPES.items() if name in types), "road"),
            location="urban" if "urban" in types else "nonurban" if "country" in types else "",
            limit_mps=self._speed(ours, xml.findtext("speedLimit"), signs),
            closed=tuple(_closed(*both) for both in zip(("left", "right"), markings, strict=True)),
            successors=[*self._refs("successor", xml)],
            predecessors=[*self._refs("predecessor", xml)],
            left_neighbours=self._neighbour("adjacentLeft", xml),
            right_neighbours=self._neighbour("adjacentRight", xml),
            markings=markings,
            both_ways=not CARS.isdisjoint(both_ways),
            signs=ours,
            lights=frozenset(ref for parent in parents for ref in self._refs("trafficLightRef", parent)),
            stop_line=stop_line,
        )

    def _refs(self, tag: str, parent: Element) -> dict[int, Element]:
        children: dict[int, Element] = {}
        for child in parent.findall(tag):
            target = element_id(child, "ref")
            if target not in self._known[tag] or (target == self._id and tag in _LINKS):
                self._file.note(f"lanelets with a {tag} that is not there, dropped", self._id)
            elif target is not None:
                children.setdefault(target, child)
        return children

    def _neighbour(self, tag: str, xml: Element) -> list[int]:
        first = [*self._refs(tag, xml).items()][:1]
        return [target for target, child in first if child.get("drivingDir") == "same"]

    def _said(self, tag: str, parent: Element | None) -> list[str]:
        texts = [child.text or "" for child in parent.findall(tag)] if parent is not None else []
        if not self._words[tag].issuperset(texts):
            self._file.note(f"lanelets with a {tag} that CommonRoad does not have, left out", self._id)
        return [text for text in texts if text in self._words[tag]]

    def _stop_lines(
        self, xml: Element, left: FloatArray, right: FloatArray
    ) -> Iterator[tuple[FloatArray, Element]]:
        for line in xml.findall("stopLine"):
            ends = points_of(line)[:, :2]
            usable = len(ends) in (0, 2) and bool(np.isfinite(ends).all())
            if usable and line.findtext("lineMarking") in self._words["lineMarking"]:
                yield (ends if len(ends) else np.array([left[-1, :2], right[-1, :2]])), line
            else:
                self._file.note("lanelets with an unusable stop line, left out", self._id)

    def _speed(self, ours: Iterable[int], written: str | None, signs: Signs) -> float | None:
        """Return the lowest speed limit, m/s; None without one, or if one is no speed."""
        shown = [sign for s in sorted(ours) for sign in signs[s] if sign.name in _SPEED_SIGNS]
        texts = [sign.values[0] if sign.values else "" for sign in shown]
        limits = [number(text) for text in (*texts, written) if text is not None]
        if all(0.0 < limit <= MAX_LIMIT_MPS for limit in limits):
            return min(limits, default=None)
        self._file.note("speed limits that are none in m/s, left out", self._id)
        return None


def _closed(side: str, marking: str) -> str:
    """Return how a marking closes a side to changes; the first word of ``dashed_solid`` is its left half."""
    closed_changes = {"dashed_solid": f"{side} leftwards", "solid_dashed": f"{side} rightwards"}
    return side if marking in _NO_CROSSING else closed_changes.get(marking, "")


def rules_of(
    file: CommonRoadFile, lanelets: Lanelets, lanes: Mapping[int, Lane], signs: Signs
) -> tuple[Regulation, ...]:
    """Regulations by signs, priority at intersections, and lights, by ascending id of their element."""
    one_way = [i for i, lane in lanes.items() if lane.kind == "vehicle" and lane.reverse_of is None]
    driven = {i: lanelets[i] for i in one_way}

    def stop_lines(users: Iterable[int]) -> tuple[FloatArray, ...]:
        return tuple(line for i in users if (line := driven[i].stop_line) is not None)

    rules = [*_priority_rules(file, driven, signs)]
    for s, elements in signs.items():
        lanes_of_sign = tuple(i for i, lanelet in driven.items() if s in lanelet.signs)
        kind = next((_SIGN_KINDS[sign.name] for sign in elements if sign.name in _SIGN_KINDS), None)
        if kind is not None and lanes_of_sign:
            rules.append(
                Regulation(
                    element_id=s,
                    kind=kind,
                    lanes=lanes_of_sign,
                    yielding=lanes_of_sign,
                    stop_lines=stop_lines(lanes_of_sign),
                    signs=tuple(sign.written for sign in elements),
                )
            )
    for light in file.elements("trafficLight"):
        if lit := tuple(i for i, lanelet in driven.items() if light in lanelet.lights):
            lines = stop_lines(lit)
            rules.append(
                Regulation(
                    element_id=light, kind="traffic_light", lanes=lit, stop_lines=lines, lights=(light,)
                )
            )
    return tuple(sorted(rules, key=lambda rule: (rule.element_id, rule.kind)))


def _priority_rules(file: CommonRoadFile, driven: Lanelets, signs: Signs) -> Iterator[Regulation]:
    """Yield the right of way of incoming lanes with a priority sign over those without, by intersection."""
    prior = {s for s, elements in signs.items() if any(sign.name in _PRIORITY_SIGNS for sign in elements)}
    for intersection, element in file.elements("intersection").items():
        priority: list[int] = []
        rest: list[int] = []
        for group in element.findall("incoming"):
            refs = [element_id(lanelet, "ref") for lanelet in group.findall("incomingLanelet")]
            lanes = [i for i in refs if i is not None and i in driven]
            (rest if all(prior.isdisjoint(driven[i].signs) for i in lanes) else priority).extend(lanes)
        yielding = tuple(i for i in rest if i not in priority)
        if priority and yielding:
            yield Regulation(
                element_id=intersection,
                kind="right_of_way",
                lanes=(*yielding, *priority),
                yielding=yielding,
                priority=tuple(priority),
            )


def drawn_lines(lanelets: Lanelets) -> list[tuple[str, str, FloatArray]]:
    """Lines to draw, as of `DrawnMap`; a line that two lanelets share is drawn once."""
    lines: dict[bytes, tuple[str, str, FloatArray]] = {}
    for lanelet in lanelets.values():
        for line, marking in zip((lanelet.left, lanelet.right), lanelet.markings, strict=True):
            drawn, points = LINES.get(marking), without_repeats(line[:, :2])
            if drawn is not None and points[::-1].tobytes() not in lines:
                lines.setdefault(points.tobytes(), (*drawn, points))
    for lanelet in lanelets.values():
        if lanelet.stop_line is not None:
            lines.setdefault(lanelet.stop_line.tobytes(), ("stop_line", "", lanelet.stop_line))
    return [*lines.values()]


def opposite_lanes(lanelets: Lanelets) -> list[Lanelet]:
    """Return the opposite lane of each lanelet that cars drive both ways, without lane changes.

    They follow each other as the lanelets do; `DrawnMap` joins them with the other lanes that they meet.
    """
    two_way = {
        i: lanelet for i, lanelet in lanelets.items() if lanelet.kind == "vehicle" and lanelet.both_ways
    }
    new_ids = dict(zip(two_way, itertools.count(max(lanelets, default=0) + 1), strict=False))
    return [
        replace(
            lanelet,
            name=new_ids[i],
            reverse_of=i,
            centre=None if lanelet.centre is None else lanelet.centre[::-1],
            left=lanelet.right[::-1],
            right=lanelet.left[::-1],
            successors=[new_ids[j] for j in lanelet.predecessors or () if j in new_ids],
            predecessors=[new_ids[j] for j in lanelet.successors or () if j in new_ids],
            left_neighbours=(),
            right_neighbours=(),
        )
        for i, lanelet in two_way.items()
    ]


def read_commonroad_road(path: str | Path, *, origin: tuple[float, float] | None = None, **_: object) -> Road:
    """Read the road network of a CommonRoad scenario, version 2018b or 2020a.

    Centrelines lie half-way between the bounds. A lane change is allowed across every marking except a solid
    line or a curb. Speed limits are those of signs (2018b: lanelets), else Germany's. Conflicts are found by
    geometry. A lanelet that cars use both ways gives two lanes. Defects are noted.

    ``origin``: None for the file's location; coordinates stay.
    """
    name_of_sign, words = library()
    file = CommonRoadFile(path=Path(path), root=parse_commonroad(Path(path)), moved=False)
    if file.root.find("lanelet") is None:
        raise MapError(f"{path}: a CommonRoad file without lanelets; name one with a road network")
    signs = signs_of(file, name_of_sign)
    lanelets = read_lanelets(file, words, signs)
    file.lanes += [*lanelets.values(), *opposite_lanes(lanelets)]
    file.lines = drawn_lines(lanelets)
    known = file.country not in ("", "ZAM")
    file.left_hand = (
        file.country in LEFT_HAND if known else drives_left_at(file.origin) if file.origin else None
    )
    road = drawn_road(file, name=map_name(path))
    others = (lane for lane in road.lanes.values() if lane.kind != "vehicle")  # drawn as regions
    return replace(
        road,
        regulations=rules_of(file, lanelets, road.lanes, signs),
        markings=road.markings if file.lines else (),  # else borders that the file does not draw
        areas=tuple(Area(area_id=x.lane_id, kind=x.subtype, outline=x.outline) for x in others),
        origin=origin or file.origin or (0.0, 0.0),
    )


COMMONROAD = MapFormat(is_mine=is_commonroad, read=read_commonroad_road, tracks=lambda path: path)
