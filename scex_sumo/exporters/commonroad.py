"""CommonRoad 2020a scenario: its road network, vehicles as obstacles, a planning problem.

The XML is written without commonroad-io, whose interface changes; tests read it with it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.light_cycles import Cycles, LightCycle, light_cycles, with_lights
from scex_sumo.exporters.request import RECORDED, Participant, Request
from scex_sumo.geometry.bounds import point_by_point
from scex_sumo.road import Lane, Road
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

_GOAL_M = (8.0, 4.0)  # length and width around the ego's last place
_GOAL_STEPS = 5  # before the end
_TYPES = {"van": "car", "tram": "train"}  # where CommonRoad differs

_LANELET_TYPES = {"vehicle": "urban", "bus": "busLane", "bicycle": "bicycleLane", "other": "border"}
_USERS = {"bicycle": "bicycle", "pedestrian": "pedestrian", "bus": "bus"}
_ORDER = ("incomingLanelet", "successorsRight", "successorsStraight", "successorsLeft")
_STRAIGHT_RAD = np.pi / 6
# SUMO's letters of the states of lights; o and O: blinking and off.
_COLOURS = {
    "r": "red",
    "s": "red",
    "u": "redYellow",
    "y": "yellow",
    "Y": "yellow",
    "g": "green",
    "G": "green",
}
_OFF = LightCycle(phases=((1, "O"),), offset=0)
_TURNS = {"l": "left", "s": "straight", "r": "right"}
_SPEED, _YIELD, _STOP = "274", "205", "206"  # Germany's, CommonRoad's default


def write_commonroad(request: Request) -> list[Path]:
    """Write a scenario for each future; an ego also gets a planning problem from its seed state to its end.

    Time step 0 is the first logged frame; with an ego, it is the seed scene, and the ego is no obstacle.
    """
    ego, files, net = request.ego_index(), [], request.run.net
    lit, cycles = with_lights(request.road, net), light_cycles(net)
    seed_step = LOGGED_HISTORY - 1 if ego is None else 0
    for future in request.futures:
        name = _benchmark(request.road.name, future)
        root = _root(name, request.file_stem(future))
        road, used = road_elements(lit, request.scene.track_ids.tolist(), cycles=cycles, seed_step=seed_step)
        root.extend(road)
        root.extend(_obstacles(request, future, ego, used))
        if ego is not None:
            root.append(_task(request, future, ego, max(used) + 1_000_000))
        ET.indent(root)
        file = request.folder / f"{name}.xml"
        request.write(file, ET.tostring(root, encoding="utf-8", xml_declaration=True))
        files.append(file)
    return files


def _benchmark(road: str, future: int) -> str:
    letters = "".join(c for c in road.title() if c.isalnum())
    configuration = "1_T-2" if future == RECORDED else f"{future + 1}_T-1"
    return f"ZAM_{letters}-1_{configuration}"


def _root(name: str, source: str) -> ET.Element:
    root = ET.Element(
        "commonRoad",
        timeStepSize=number_text(STEP_S),
        commonRoadVersion="2020a",
        author="scex-sumo",
        affiliation="",
        source=source,
        benchmarkID=name,
        date="2020-01-01",  # fixed, for reproducible bytes
    )
    location = add(root, "location")
    for tag, value in (("geoNameId", "-999"), ("gpsLatitude", "999"), ("gpsLongitude", "999")):
        add(location, tag, value)
    add(add(root, "scenarioTags"), "simulated")
    return root


def _obstacles(request: Request, future: int, ego: int | None, used: set[int]) -> Iterable[ET.Element]:
    first, scene = 0 if ego is None else LOGGED_HISTORY - 1, request.scene
    free = max([*used, *scene.track_ids.tolist()]) + 1
    for participant in request.participants(future):
        there = np.flatnonzero(participant.present[first:])
        if len(there) and (participant.vehicle is None or participant.vehicle != ego):
            number = free + participant.index + (scene.vehicles if participant.vehicle is None else 0)
            if isinstance(participant.label, int) and participant.label > 0 and participant.label not in used:
                number = participant.label
            yield _obstacle(
                number, participant, participant.states[first:][there[0] : there[-1] + 1], int(there[0])
            )


def _obstacle(number: int, participant: Participant, states: States, first: int) -> ET.Element:
    element = ET.Element("dynamicObstacle", id=str(number))
    add(element, "type", _TYPES.get(road_user(participant.kind), road_user(participant.kind)))
    box = add(add(element, "shape"), "rectangle")
    add(box, "length", number_text(participant.length))
    add(box, "width", number_text(participant.width))
    trajectory = np.stack([states.x, states.y, states.heading, states.speed], axis=1)
    _state(add(element, "initialState"), trajectory[0], first)
    if len(trajectory) > 1:
        line = add(element, "trajectory")
        for t, state in enumerate(trajectory[1:], start=first + 1):
            _state(add(line, "state"), state, t)
    return element


def _state(element: ET.Element, state: FloatArray, step: int) -> None:
    _point(add(element, "position"), state)
    for tag, value in (("orientation", state[2]), ("time", step), ("velocity", state[3])):
        add(add(element, tag), "exact", str(value) if tag == "time" else number_text(value))


def _task(request: Request, future: int, ego: int, number: int) -> ET.Element:
    states = next(user.states[user.present] for user in request.participants(future) if user.vehicle == ego)
    steps = states.shape[0] - LOGGED_HISTORY
    now, end = states[LOGGED_HISTORY - 1], states[-1]
    task = ET.Element("planningProblem", id=str(number))
    start = add(task, "initialState")
    _state(start, np.array([now.x, now.y, now.heading, now.speed]), 0)
    for tag in ("yawRate", "slipAngle"):
        add(add(start, tag), "exact", "0.0")
    goal = add(task, "goalState")
    box = add(add(goal, "position"), "rectangle")
    length, width = _GOAL_M
    for tag, value in (("length", length), ("width", width), ("orientation", float(end.heading))):
        add(box, tag, number_text(value))
    _point(box, np.array([end.x, end.y]), "center")
    time = add(goal, "time")
    add(time, "intervalStart", str(max(steps - _GOAL_STEPS, 1)))
    add(time, "intervalEnd", str(steps))
    return task


def add(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    """Append an element, and return it."""
    element = ET.SubElement(parent, tag)
    element.text = text
    return element


def number_text(value: float) -> str:
    """Return a number without an exponent, exact to the nanometre."""
    text = f"{float(value):.9f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


@dataclass(kw_only=True, eq=False)
class _Signals:
    elements: list[ET.Element] = field(default_factory=list)
    of_lane: dict[int, list[tuple[str, int]]] = field(default_factory=dict)
    stop_lines: dict[int, tuple[FloatArray, str, int]] = field(default_factory=dict)

    def refer(self, lanes: list[int], tag: str, number: int) -> None:
        for i in lanes:
            self.of_lane.setdefault(i, []).append((tag, number))


def lanelet_numbers(road: Road, taken: Collection[int] = ()) -> dict[int, int]:
    """Return lanelet ids by lane: the map's own if all are positive, else new ones above ``taken``."""
    lanes = [i for i, lane in road.lanes.items() if lane.reverse_of is None]
    first = 0 if all(i > 0 for i in lanes) else max([0, *taken]) + 1
    return {i: first + k if first else i for k, i in enumerate(lanes)}


def road_elements(
    road: Road, taken: Collection[int] = (), *, cycles: Cycles | None = None, seed_step: int = 0
) -> tuple[list[ET.Element], set[int]]:
    """Return the elements of a road, and all their ids.

    Args:
        taken: ids of obstacles.
        cycles: of the lights; those at other lanes are off.
        seed_step: time step of the seed scene.
    """
    numbers = lanelet_numbers(road, taken)
    signals = _signals(road, numbers, cycles or {}, seed_step)
    both_ways = {lane.reverse_of for lane in road.lanes.values()} - {None}
    lanelets = [_lanelet(road.lanes[i], numbers, signals, both=i in both_ways) for i in numbers]
    signs = {int(element.get("id", "0")) for element in signals.elements}
    crossings = _intersections(road, numbers, max([*numbers.values(), *signs, *taken]) + 1)
    elements = [*lanelets, *signals.elements, *crossings]
    return elements, {int(numbered.get("id", "0")) for e in elements for numbered in (e, *e.iter("incoming"))}


def _signals(road: Road, numbers: Mapping[int, int], cycles: Cycles, seed_step: int) -> _Signals:
    signals, free = _Signals(), max(numbers.values()) + 1
    driven = [i for i in numbers if road.lanes[i].kind == "vehicle"]
    for speed in sorted({road.lanes[i].speed_limit_mps for i in driven}):
        lanes = [i for i in driven if road.lanes[i].speed_limit_mps == speed]
        signals.elements.append(_sign(free, _SPEED, road.lanes[lanes[0]], number_text(speed)))
        signals.refer(lanes, "trafficSignRef", free)
        free += 1
    for rule in road.regulations:
        bound = rule.lanes if rule.kind == "traffic_light" else rule.yielding or rule.lanes
        lanes = [i for i in bound if i in numbers]
        if not lanes:
            continue
        lit = rule.kind == "traffic_light"
        tag = "trafficLightRef" if lit else "trafficSignRef"
        if len(rule.stop_lines) == 1 and len(lanes) == 1 and len(rule.stop_lines[0]) > 1:
            signals.stop_lines[lanes[0]] = rule.stop_lines[0], tag, free
        if lit:
            for (cycle, turns), under in _lights(lanes, cycles).items():
                signals.elements.append(_light(free, cycle, turns, road.lanes[under[0]], seed_step))
                signals.refer(under, tag, free)
                free += 1
        else:
            kind = _STOP if rule.kind in ("stop", "all_way_stop") else _YIELD
            signals.elements.append(_sign(free, kind, road.lanes[lanes[0]]))
            signals.refer(lanes, tag, free)
            free += 1
    signals.elements.sort(key=lambda element: element.tag == "trafficLight")  # the format wants signs first
    return signals


def _lights(lanes: list[int], cycles: Cycles) -> dict[tuple[LightCycle, str], list[int]]:
    """Return the lanes of each light: cycle, and direction where the cycles of a lane differ by it."""
    lanes_of: dict[tuple[LightCycle, str], list[int]] = {}
    for lane in lanes:
        at_lane = cycles.get(lane, {_OFF: ""})
        for cycle, letters in at_lane.items():
            turns = [turn for letter, turn in _TURNS.items() if letter in letters.lower().replace("t", "l")]
            apart = len(at_lane) > 1 and 0 < len(turns) < len(_TURNS)
            direction = turns[0] + "".join(turn.title() for turn in turns[1:]) if apart else "all"
            lanes_of.setdefault((cycle, direction), []).append(lane)
    return lanes_of


def _light(number: int, cycle: LightCycle, turns: str, lane: Lane, seed_step: int) -> ET.Element:
    light = ET.Element("trafficLight", id=str(number))
    repeated = add(light, "cycle")
    for steps, letter in cycle.phases:
        phase = add(repeated, "cycleElement")
        add(phase, "duration", str(steps))
        add(phase, "color", _COLOURS.get(letter, "inactive"))
    whole = sum(steps for steps, _ in cycle.phases)
    add(repeated, "timeOffset", str((seed_step + cycle.offset - 1) % whole + 1))  # positive, by the format
    _point(add(light, "position"), lane.centreline[-1])
    add(light, "direction", turns)
    add(light, "active", "false" if cycle is _OFF else "true")
    return light


def _intersections(road: Road, numbers: Mapping[int, int], first: int) -> list[ET.Element]:
    lanes = {i: lane for i, lane in road.vehicle_lanes.items() if i in numbers}
    elements, ids, left = [], count(first), [i for i, lane in lanes.items() if lane.conflicts]
    while left:
        inside, reached = set[int](), [left[0]]
        while reached:
            lane = reached.pop()
            if lane in lanes and lane not in inside:
                inside.add(lane)
                reached += lanes[lane].conflicts
        left = [i for i in left if i not in inside]
        entries = sorted({p for i in inside for p in lanes[i].predecessors if p in lanes} - inside)
        if len(entries) < 2:
            continue
        element = ET.Element("intersection", id=str(next(ids)))
        elements.append(element)
        arms = {entry: add(element, "incoming") for entry in entries if not _beside(lanes[entry], entries)}
        for entry in entries:
            leftmost = entry
            while leftmost not in arms:
                leftmost = _beside(lanes[leftmost], entries)[0]
            add(arms[leftmost], "incomingLanelet").set("ref", str(numbers[entry]))
            for i in lanes[entry].successors:
                if i in inside:
                    add(arms[leftmost], f"successors{_turn(lanes[i])}").set("ref", str(numbers[i]))
        for arm in arms.values():
            arm.set("id", str(next(ids)))
            arm[:] = sorted(arm, key=lambda reference: _ORDER.index(reference.tag))
    return elements


def _beside(lane: Lane, entries: list[int]) -> list[int]:
    return [i for i in (lane.left, lane.adjacent_left) if i is not None and i in entries]


def _turn(lane: Lane) -> str:
    begin, end = np.diff(lane.centreline, axis=0)[[0, -1]] @ (1, 1j)
    angle = float(np.angle(end / begin))
    return "Straight" if abs(angle) < _STRAIGHT_RAD else "Left" if angle > 0 else "Right"


def _sign(number: int, kind: str, lane: Lane, value: str | None = None) -> ET.Element:
    sign = ET.Element("trafficSign", id=str(number))
    element = add(sign, "trafficSignElement")
    add(element, "trafficSignID", kind)
    if value is not None:
        add(element, "additionalValue", value)
    _point(add(sign, "position"), lane.right_bound[0])
    add(sign, "virtual", "false")
    return sign


def _lanelet(lane: Lane, numbers: Mapping[int, int], signals: _Signals, *, both: bool) -> ET.Element:
    element = ET.Element("lanelet", id=str(numbers[lane.lane_id]))
    left, right = lane.left_bound, lane.right_bound
    if len(left) != len(right):
        left, right = point_by_point([left, right])
    sides = (("left", left, lane.left, lane.adjacent_left), ("right", right, lane.right, lane.adjacent_right))
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
        points, tag, number = signals.stop_lines[lane.lane_id]
        for point in points[[0, -1]]:
            _point(line, point)
        add(line, "lineMarking", "broad_solid")
        add(line, tag).set("ref", str(number))
    walked = "crosswalk" if lane.subtype == "crosswalk" else "sidewalk"
    kind = walked if lane.kind == "pedestrian" else _LANELET_TYPES.get(lane.kind, "unknown")
    add(element, "laneletType", kind)
    add(element, "userBidirectional" if both else "userOneWay", _USERS.get(lane.kind, "vehicle"))
    # The format wants signs before lights.
    for tag, number in sorted(signals.of_lane.get(lane.lane_id, ()), key=lambda ref: ref[0], reverse=True):
        add(element, tag).set("ref", str(number))
    return element


def _point(parent: ET.Element, place: FloatArray, tag: str = "point") -> None:
    point = add(parent, tag)
    add(point, "x", number_text(place[0]))
    add(point, "y", number_text(place[1]))
