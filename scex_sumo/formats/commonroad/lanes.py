"""Lanes, regulations and lines of a CommonRoad map, by types, road users, markings and signs of lanelets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.tags import default_speed_mps
from scex_sumo.converters.naming import number
from scex_sumo.formats.commonroad.file import CommonRoadFile, Lanelet, element_id
from scex_sumo.geometry.polylines import bounds_cross, mean_width_m, without_repeats
from scex_sumo.road import Area, Lane, Marking, Regulation

CARS = {"vehicle", "car"}
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
JOINT_M = 0.1  # two lanes follow each other if both bounds meet within this distance
MAX_LIMIT_MPS = 70.0  # no limit is above 250 km/h; greater numbers are km/h by mistake


@dataclass(frozen=True, kw_only=True)
class Sign:
    """Element of a traffic sign.

    Attributes:
        name: CommonRoad's name, the same in every country, e.g. ``YIELD``, ``MAX_SPEED``.
        written: as the file has it, e.g. ``205``.
    """

    name: str
    written: str
    values: tuple[str, ...] = ()


def kind_by_types(types: frozenset[str], users: frozenset[str]) -> str:
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


def lane_tags(types: frozenset[str]) -> dict[str, str]:
    """CommonRoad's lanelet types as Lanelet2's ``subtype`` and ``location``."""
    subtype = next((word for name, word in _SUBTYPES.items() if name in types), "road")
    location = "urban" if "urban" in types else "nonurban" if "country" in types else ""
    return {"subtype": subtype, "location": location}


Signs: TypeAlias = Mapping[int, tuple[Sign, ...]]
Lanelets: TypeAlias = Mapping[int, Lanelet]


def lanes_of(file: CommonRoadFile, lanelets: Lanelets, signs: Signs) -> dict[int, Lane]:
    """Build lanes without relations to others; doubts go into the file's notes."""
    lanes = {}
    limited = set()
    for i, lanelet in lanelets.items():
        left, right, centreline = (_xy(line) for line in (lanelet.left, lanelet.right, lanelet.centre))
        if len(centreline) < 2:
            file.note("lanelets left out, no length between their bounds", i)
            continue
        if bounds_cross(left, right):
            file.note("bounds cross each other or themselves, the lane's shape may be off", i)
        kind = kind_by_types(lanelet.types, lanelet.one_way | lanelet.both_ways)
        tags = lane_tags(lanelet.types)
        speed = _speed(file, i, lanelet, signs)
        if speed is not None:
            limited.add(i)
        lanes[i] = Lane(
            lane_id=i,
            centreline=centreline,
            left_bound=left,
            right_bound=right,
            width_m=mean_width_m(left, right),
            speed_limit_mps=speed or default_speed_mps(tags, kind),
            kind=kind,
            subtype=tags["subtype"],
            location=tags["location"],
        )
    _remark_limits(file, [lane for lane in lanes.values() if lane.kind == "vehicle"], limited)
    return lanes


def _xy(line: FloatArray) -> FloatArray:
    return without_repeats(line[:, :2])


def _remark_limits(file: CommonRoadFile, lanes: list[Lane], limited: set[int]) -> None:
    unsigned = [lane for lane in lanes if lane.lane_id not in limited]
    if unsigned:
        kmh = sorted({round(lane.speed_limit_mps * 3.6) for lane in unsigned})
        limits = "/".join(str(limit) for limit in kmh)
        file.remarks.append(
            f"{len(unsigned)} of {len(lanes)} lanelets have no speed limit: {limits} km/h by their type"
        )


def _speed(file: CommonRoadFile, i: int, lanelet: Lanelet, signs: Signs) -> float | None:
    shown = [sign for s in sorted(lanelet.signs) for sign in signs.get(s, ()) if sign.name in _SPEED_SIGNS]
    texts = [sign.values[0] if sign.values else "" for sign in shown]
    limits = [number(text) for text in (*texts, lanelet.speed_limit) if text is not None]
    if all(0.0 < limit <= MAX_LIMIT_MPS for limit in limits):
        return min(limits, default=None)
    file.note("speed limits that are none in m/s, left out", i)
    return None


def driven_both_ways(lanelets: Lanelets, lanes: Mapping[int, Lane]) -> list[int]:
    """Vehicle lanes that cars may use in both directions."""
    return [i for i, lane in lanes.items() if lane.kind == "vehicle" and lanelets[i].both_ways & CARS]


def may_change(lanelets: Lanelets, left: int, right: int, leftwards: bool) -> bool:
    """Return whether the markings between two lanelets allow a lane change.

    The first word of ``dashed_solid`` is the left half of the line.
    """
    closed = {*_NO_CROSSING, "dashed_solid" if leftwards else "solid_dashed"}
    return closed.isdisjoint((lanelets[left].right_marking, lanelets[right].left_marking))


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


def drawn_markings(lanelets: Lanelets) -> tuple[Marking, ...]:
    """Lines to draw, with new ids; a line that two lanelets share is drawn once."""
    lines: dict[bytes, tuple[str, str, FloatArray]] = {}
    for lanelet in lanelets.values():
        for line, marking in ((lanelet.left, lanelet.left_marking), (lanelet.right, lanelet.right_marking)):
            drawn, points = LINES.get(marking), _xy(line)
            if drawn is not None and points[::-1].tobytes() not in lines:
                lines.setdefault(points.tobytes(), (*drawn, points))
    for lanelet in lanelets.values():
        if lanelet.stop_line is not None:
            lines.setdefault(lanelet.stop_line.tobytes(), ("stop_line", "", lanelet.stop_line))
    return tuple(
        Marking(line_id=k, kind=kind, subtype=subtype, points=points)
        for k, (kind, subtype, points) in enumerate(lines.values(), start=1)
    )


def drawn_areas(lanes: Mapping[int, Lane]) -> tuple[Area, ...]:
    """Regions to draw: lanelets without cars."""
    return tuple(
        Area(area_id=i, kind=lane.subtype, outline=lane.outline)
        for i, lane in lanes.items()
        if lane.kind != "vehicle"
    )


def with_reverse(lanes: Mapping[int, Lane], both_ways: Iterable[int]) -> dict[int, Lane]:
    """Add the opposite lane of each connected lane that cars drive both ways, without lane changes."""
    result = dict(lanes)
    turned: dict[int, int] = {}
    for i in sorted(both_ways):
        lane = lanes[i]
        turned[i] = max(result) + 1
        result[turned[i]] = replace(
            lane,
            lane_id=turned[i],
            centreline=lane.centreline[::-1],
            left_bound=lane.right_bound[::-1],
            right_bound=lane.left_bound[::-1],
            successors=(),
            predecessors=(),
            left=None,
            right=None,
            adjacent_left=None,
            adjacent_right=None,
            reverse_of=i,
        )
    pairs = {(turned[j], turned[i]) for i in turned for j in lanes[i].successors if j in turned}
    pairs |= _joined(result, set(turned.values()))
    for a, b in sorted(pairs):
        result[a] = replace(result[a], successors=tuple(sorted({*result[a].successors, b})))
        result[b] = replace(result[b], predecessors=tuple(sorted({*result[b].predecessors, a})))
    return result


def _joined(lanes: Mapping[int, Lane], turned: set[int]) -> set[tuple[int, int]]:
    driven = [lane for lane in lanes.values() if lane.kind == "vehicle"]
    if not turned:
        return set()
    starts, ends = _ends(driven, 0), _ends(driven, -1)
    near = np.abs(ends[:, None] - starts[None]).max(axis=2) < JOINT_M
    met = ((driven[k], driven[m]) for k, m in np.argwhere(near))
    return {
        (a.lane_id, b.lane_id)
        for a, b in met
        if {a.lane_id, b.lane_id} & turned and b.lane_id != a.reverse_of and a.lane_id != b.reverse_of
    }


def _ends(lanes: list[Lane], index: int) -> FloatArray:
    return np.array([[*lane.left_bound[index], *lane.right_bound[index]] for lane in lanes])
