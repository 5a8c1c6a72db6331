"""Road network of a CommonRoad scenario: lanelets, signs and lights."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.exporters.xml_text import add, number_text
from scex_sumo.geometry.polylines import along, arc_lengths
from scex_sumo.road import Lane, Regulation, Road

_TYPES = {"vehicle": "urban", "bus": "busLane", "bicycle": "bicycleLane", "other": "border"}
_USERS = {"bicycle": "bicycle", "pedestrian": "pedestrian", "bus": "bus"}
_SPEED, _YIELD, _STOP = "274", "205", "206"  # Germany's numbers, which are CommonRoad's for no country


@dataclass(kw_only=True, eq=False)
class _Signals:
    """What stands beside the lanes: elements, and for each lane what refers to them."""

    elements: list[ET.Element] = field(default_factory=list)
    of_lane: dict[int, list[tuple[str, int]]] = field(default_factory=dict)
    stop_lines: dict[int, FloatArray] = field(default_factory=dict)

    def refer(self, lanes: list[int], tag: str, number: int) -> None:
        """Let lanes refer to a sign or light."""
        for i in lanes:
            self.of_lane.setdefault(i, []).append((tag, number))


def lanelet_numbers(road: Road, taken: Collection[int] = ()) -> dict[int, int]:
    """Ids of the lanelets by lane: the map's own where all are positive, else from beyond those taken on."""
    own = [i for i, lane in road.lanes.items() if lane.reverse_of is None]
    first = max([0, *taken]) + 1
    return {i: i for i in own} if all(i > 0 for i in own) else {i: first + k for k, i in enumerate(own)}


def road_elements(road: Road, taken: Collection[int] = ()) -> tuple[list[ET.Element], set[int]]:
    """The lanelets, signs and lights of a road, and all ids that they take.

    Args:
        road: the road.
        taken: ids of obstacles, which lanelets that need a new one leave to them.
    """
    numbers = lanelet_numbers(road, taken)
    signals = _signals(road, numbers)
    both_ways = {lane.reverse_of for lane in road.lanes.values()} - {None}
    lanelets = [_lanelet(road.lanes[i], numbers, signals, both=i in both_ways) for i in numbers]
    used = {int(element.get("id", "0")) for element in signals.elements}
    return [*lanelets, *signals.elements], used | set(numbers.values())


def point_by_point(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two borders with as many points each, all their own among them."""
    if len(left) == len(right):
        return left, right
    arcs = [arc_lengths(line) for line in (left, right)]
    share = np.unique(np.concatenate([arc / max(arc[-1], 1e-9) for arc in arcs]).round(9))
    a, b = (along(line, share * arc[-1]) for line, arc in zip((left, right), arcs, strict=True))
    return np.asarray(a), np.asarray(b)


def _signals(road: Road, numbers: Mapping[int, int]) -> _Signals:
    """A speed sign for each limit, and what each rule puts there."""
    found, free = _Signals(), max(numbers.values()) + 1
    driven = [i for i in numbers if road.lanes[i].kind == "vehicle"]
    for speed in sorted({road.lanes[i].speed_limit_mps for i in driven}):
        lanes = [i for i in driven if road.lanes[i].speed_limit_mps == speed]
        found.elements.append(_sign(free, _SPEED, road.lanes[lanes[0]], number_text(speed)))
        found.refer(lanes, "trafficSignRef", free)
        free += 1
    for rule in road.regulations:
        lanes = [i for i in _bound(rule) if i in numbers]
        if not lanes:
            continue
        first = road.lanes[lanes[0]]
        if rule.kind == "traffic_light":
            light = ET.Element("trafficLight", id=str(free))
            _point(add(light, "position"), first.centreline[-1])
            add(light, "direction", "all")
            add(light, "active", "true")
            found.elements.append(light)
            found.refer(lanes, "trafficLightRef", free)
        else:
            kind = _STOP if rule.kind in ("stop", "all_way_stop") else _YIELD
            found.elements.append(_sign(free, kind, first))
            found.refer(lanes, "trafficSignRef", free)
        if len(rule.stop_lines) == 1 and len(lanes) == 1 and len(rule.stop_lines[0]) > 1:
            found.stop_lines[lanes[0]] = rule.stop_lines[0]
        free += 1
    lights = [element for element in found.elements if element.tag == "trafficLight"]
    found.elements = [element for element in found.elements if element.tag != "trafficLight"] + lights
    return found


def _bound(rule: Regulation) -> tuple[int, ...]:
    """The lanes that a rule tells to wait."""
    return rule.lanes if rule.kind == "traffic_light" else rule.yielding or rule.lanes


def _sign(number: int, kind: str, lane: Lane, value: str | None = None) -> ET.Element:
    sign = ET.Element("trafficSign", id=str(number))
    part = add(sign, "trafficSignElement")
    add(part, "trafficSignID", kind)
    if value is not None:
        add(part, "additionalValue", value)
    _point(add(sign, "position"), lane.right_bound[0])
    add(sign, "virtual", "false")
    return sign


def _lanelet(lane: Lane, numbers: Mapping[int, int], signals: _Signals, *, both: bool) -> ET.Element:
    element = ET.Element("lanelet", id=str(numbers[lane.lane_id]))
    left, right = point_by_point(lane.left_bound, lane.right_bound)
    sides = (
        ("left", left, lane.left, lane.adjacent_left),
        ("right", right, lane.right, lane.adjacent_right),
    )
    for side, points, free, near in sides:
        bound = add(element, f"{side}Bound")
        for point in points:
            _point(bound, point)
        if near is not None or free is not None:
            add(bound, "lineMarking", "dashed" if free is not None else "solid")
    for tag, others in (("predecessor", lane.predecessors), ("successor", lane.successors)):
        for i in others:
            if i in numbers:
                add(element, tag).set("ref", str(numbers[i]))
    for side, _, free, near in sides:
        other = near if near is not None else free
        if other is not None and other in numbers:
            beside = add(element, f"adjacent{side.title()}")
            beside.set("ref", str(numbers[other]))
            beside.set("drivingDir", "same")
    if lane.lane_id in signals.stop_lines:
        line = add(element, "stopLine")
        for point in signals.stop_lines[lane.lane_id][[0, -1]]:
            _point(line, point)
        add(line, "lineMarking", "broad_solid")
    walked = "crosswalk" if lane.subtype == "crosswalk" else "sidewalk"
    add(element, "laneletType", walked if lane.kind == "pedestrian" else _TYPES.get(lane.kind, "unknown"))
    add(element, "userBidirectional" if both else "userOneWay", _USERS.get(lane.kind, "vehicle"))
    # In the order of the format: signs before lights.
    for tag, number in sorted(signals.of_lane.get(lane.lane_id, ()), key=lambda ref: ref[0], reverse=True):
        add(element, tag).set("ref", str(number))
    return element


def _point(parent: ET.Element, place: FloatArray) -> None:
    point = add(parent, "point")
    add(point, "x", number_text(place[0]))
    add(point, "y", number_text(place[1]))
