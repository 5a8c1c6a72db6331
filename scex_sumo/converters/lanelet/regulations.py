"""Right of way, stops and traffic lights of a map file, attached to lanes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile, Points, Relation, Tags
from scex_sumo.geometry.polylines import along, length_of, turn
from scex_sumo.road import Lane, Regulation
from scex_sumo.roads.places import lanes_ahead

BESIDE_M = 0.5  # a stop line may end this far beside the centreline that it stops
MIN_SLANT_RAD = 0.7  # 40 degrees
AHEAD_M = 30.0  # where conflicts begin behind a stop line
LIGHT_M = 6.0  # from a light without an element to its stop line
_REGULATIONS = {"right_of_way", "all_way_stop", "traffic_light"}
_SIGN_ELEMENTS = {"traffic_sign", "stop_sign", "yield_sign", "stop", "yield", "give_way"}
_STOP_SIGNS = {"stop", "stopsign", "de206", "usr1-1", "r1-1"}
_YIELD_SIGNS = {"yield", "yieldsign", "giveway", "de205", "usr1-2", "r1-2"}

_STOPS = ("traffic_light", "stop", "yield")

_TaggedWays: TypeAlias = dict[int, tuple[str, Tags]]


def regulations(map_file: MapFile, lanes: Mapping[int, Lane], lines: Points) -> tuple[Regulation, ...]:
    """Return the right of way, stops and lights of a map by ascending id, naming usable lanes only."""
    users: dict[int, list[int]] = {}
    for lane_id in (i for i in lanes if i in map_file.relations):
        for ref in map_file.relations[lane_id].refs("regulatory_element", "relation"):
            users.setdefault(ref, []).append(lane_id)
    rules = []
    for element_id, element in map_file.of_type("regulatory_element").items():
        signs = _signs(element, map_file)
        kind = _kind(element, signs)
        if kind is None:
            continue
        named = users.get(element_id, [])
        yielding = [i for i in element.refs("yield", "relation") if i in lanes]
        if kind in ("stop", "yield", "all_way_stop"):
            yielding += [i for i in named if i not in yielding]
        stop_lines, lights = _lines_and_lights(element, map_file)
        rule = Regulation(
            element_id=element_id,
            kind=kind,
            lanes=tuple(named),
            yielding=tuple(yielding),
            priority=tuple(i for i in element.refs("right_of_way", "relation") if i in lanes),
            stop_lines=tuple(lines[i] for i in stop_lines if i in lines and len(lines[i]) > 1),
            lights=tuple(lights) if kind == "traffic_light" else (),
            signs=signs,
        )
        rules.append(rule)
    return tuple(rules)


def _lines_and_lights(element: Relation, map_file: MapFile) -> tuple[list[int], list[int]]:
    ways = _ways(element, ("refers", "ref_line", "stop_line"), map_file)
    kinds = {i: (role, tags.get("type")) for i, (role, tags) in ways.items()}
    swapped = ("ref_line", "traffic_sign") in kinds.values()
    stop_lines = [
        i
        for i, (role, kind) in kinds.items()
        if kind not in ("traffic_sign", "traffic_light") and (role != "refers" or swapped)
    ]
    lights = [i for i, (_, kind) in kinds.items() if kind == "traffic_light"]
    return stop_lines, lights or [i for i, (role, _) in kinds.items() if role == "refers"]


def _ways(element: Relation, roles: tuple[str, ...], map_file: MapFile) -> _TaggedWays:
    members = [m for m in element.members if m.kind == "way" and m.role in roles and m.ref in map_file.ways]
    return {m.ref: (m.role, map_file.ways[m.ref].tags) for m in members}


def _signs(element: Relation, map_file: MapFile) -> tuple[str, ...]:
    ways = _ways(element, ("refers", "ref_line"), map_file).values()
    signs = [tags.get("subtype", "") for _, tags in ways if tags.get("type") == "traffic_sign"]
    return tuple(sign for sign in [element.tags.get("sign_type", ""), *signs] if sign)


def _kind(element: Relation, signs: Iterable[str]) -> str | None:
    subtype = element.tags.get("subtype", "")
    if subtype in _REGULATIONS:
        return subtype
    if subtype not in _SIGN_ELEMENTS:
        return None
    words = {sign.lower().replace("_", "") for sign in (*signs, subtype)}
    if words & _STOP_SIGNS:
        return "stop"
    return "yield" if words & _YIELD_SIGNS else None


def attach(
    rules: tuple[Regulation, ...], lanes: Mapping[int, Lane], map_file: MapFile, lines: Points
) -> tuple[tuple[Regulation, ...], list[int], list[int]]:
    """Attach stops, yields and lights that no lanelet names to the lanes at their stop lines.

    Returns all rules, ids of those attached here, and ids of the lights that got no lane.
    """
    named = {m.ref for r in map_file.of_type("regulatory_element").values() for m in r.members}
    unnamed = [i for i in sorted(map_file.ways) if i not in named and len(lines.get(i, ())) > 1]
    kinds = {i: map_file.ways[i].tags.get("type") for i in unnamed}
    bare = [i for i in unnamed if kinds[i] == "traffic_light"]
    loose = [r for r in rules if r.kind in _STOPS and not r.lanes and not r.yielding]
    if not loose and not bare:
        return rules, [], []
    free = {i: lines[i] for i in unnamed if kinds[i] == "stop_line"}
    drivable = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    attached: dict[int, Regulation] = {}
    for rule in [*loose, *_bare_lights(bare, free, lines)]:
        stops = rule.stop_lines or tuple(lines[i] for i in rule.lights if len(lines.get(i, ())) > 1)
        there = {i for stop in stops for i in _lanes_at(stop, drivable)}
        # Where a lane ends at the line and another begins there, the first one is held.
        held = tuple(sorted(i for i in there if there.isdisjoint(drivable[i].predecessors)))
        if held:
            yielding = held if rule.kind != "traffic_light" else ()
            attached[rule.element_id] = replace(rule, lanes=held, yielding=yielding)
    lost = [r.element_id for r in loose if r.kind == "traffic_light" and r.element_id not in attached]
    attached_lights = {i for rule in attached.values() for i in rule.lights}
    lost += [i for i in bare if i not in attached_lights]
    everything = {rule.element_id: rule for rule in rules} | attached
    return tuple(rule for _, rule in sorted(everything.items())), sorted(attached), sorted(lost)


def _lanes_at(stop: FloatArray, lanes: Mapping[int, Lane]) -> Iterator[int]:
    direction = stop[-1] - stop[0]
    beside = BESIDE_M * direction / max(float(length_of(stop[[0, -1]])), 1e-6)
    across = shapely.LineString(np.vstack([stop[0] - beside, stop[1:-1], stop[-1] + beside]))
    for i, lane in lanes.items():
        centre = shapely.LineString(lane.centreline)
        if centre.distance(across) > 0.05:
            continue
        length = centre.length
        s = float(centre.project(shapely.Point(shapely.shortest_line(centre, across).coords[0])))
        step = along(lane.centreline, min(s + 0.5, length)) - along(lane.centreline, max(s - 0.5, 0.0))
        slant = abs(turn(math.atan2(*direction[::-1]), math.atan2(*step[::-1])))
        if min(slant, math.pi - slant) < MIN_SLANT_RAD:
            continue
        onward = [j for j in lane.successors if j in lanes]
        if s <= length / 2:
            if lane.conflicts:
                yield i
        elif lane.conflicts:
            yield from (j for j in onward if lanes[j].conflicts)
        elif any(lanes[j].conflicts for j in lanes_ahead(lanes, onward, AHEAD_M)):
            yield i


def _bare_lights(bare: Sequence[int], free: Mapping[int, FloatArray], lines: Points) -> Iterator[Regulation]:
    places = {i: shapely.LineString(line) for i, line in free.items()}
    lights: dict[int, list[int]] = {}
    for i in bare:
        light = shapely.LineString(lines[i])
        near = min(places, key=lambda j: (light.distance(places[j]), j), default=None)
        if near is not None and light.distance(places[near]) <= LIGHT_M:
            lights.setdefault(near, []).append(i)
    for stop, of_stop in lights.items():
        yield Regulation(
            element_id=min(of_stop), kind="traffic_light", stop_lines=(free[stop],), lights=tuple(of_stop)
        )
