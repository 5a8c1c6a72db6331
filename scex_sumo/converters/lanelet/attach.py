"""Stops, yields and lights of a map that no lanelet names, attached to the lanes at their stop lines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile, Points
from scex_sumo.converters.lanelet.regulations import elements_members, ways_of_type
from scex_sumo.geometry.polylines import along, length_of, turn
from scex_sumo.road import Lane, Regulation
from scex_sumo.roads.ahead import lanes_ahead

BESIDE_M = 0.5  # a stop line may end this far beside the centreline that it stops
MIN_SLANT_RAD = 0.7  # 40 degrees
AHEAD_M = 30.0  # where conflicts begin behind a stop line
LIGHT_M = 6.0  # from a light without an element to its stop line


def attach(
    rules: Sequence[Regulation],
    loose: Sequence[Regulation],
    bare: Sequence[int],
    lanes: Mapping[int, Lane],
    map_file: MapFile,
    lines: Points,
) -> tuple[tuple[Regulation, ...], list[int], list[int]]:
    """Attach stops, yields and lights to the lanes at their stop lines.

    Args:
        loose: those of the rules that no lanelet names; ``bare``: lights without a rule.

    Returns:
        All rules, ids of those attached here, and ids of the lights that got no lane.
    """
    named = elements_members(map_file)
    free = {i: lines[i] for i in ways_of_type(map_file, "stop_line", lines) if i not in named}
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
    across = shapely.LineString(_prolonged(stop))
    direction = stop[-1] - stop[0]
    for i, lane in lanes.items():
        centre = shapely.LineString(lane.centreline)
        if centre.distance(across) > 0.05:
            continue
        length = centre.length
        s = float(centre.project(shapely.Point(shapely.shortest_line(centre, across).coords[0])))
        step = along(lane.centreline, min(s + 0.5, length)) - along(lane.centreline, max(s - 0.5, 0.0))
        slant = abs(turn(_angle(direction), _angle(step)))
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


def _prolonged(stop: FloatArray) -> FloatArray:
    unit = (stop[-1] - stop[0]) / max(float(length_of(stop[[0, -1]])), 1e-6)
    result: FloatArray = stop.copy()
    result[0] -= BESIDE_M * unit
    result[-1] += BESIDE_M * unit
    return result


def _angle(vector: FloatArray) -> float:
    return math.atan2(vector[1], vector[0])
