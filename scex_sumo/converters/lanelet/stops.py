"""Stop lines and traffic lights that no lanelet names: attached to lanes by where they lie."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.elements import Points
from scex_sumo.converters.lanelet.file import MapFile
from scex_sumo.geometry.polylines import along, length_of, turn
from scex_sumo.road import Lane, Regulation

BESIDE_M = 0.5  # a stop line may end this far beside the centreline that it stops
LEAST_RAD = 0.7  # 40 degrees: a line along the lane is none to stop at
AHEAD_M = 30.0  # where conflicts begin behind a stop line
LIGHT_M = 6.0  # from a light without an element to its stop line
_STOPS = ("traffic_light", "stop", "yield")


@dataclass(frozen=True, kw_only=True, eq=False)
class Attached:
    """Rules with the lanes that they lie on.

    Attributes:
        rules: all rules of the map, by ascending id.
        found: ids of those that no lanelet names, attached by geometry.
        lost: ids of lights that are attached to nothing.
    """

    rules: tuple[Regulation, ...]
    found: tuple[int, ...]
    lost: tuple[int, ...]


def attach(
    rules: Sequence[Regulation], lanes: Mapping[int, Lane], map_file: MapFile, lines: Points
) -> Attached:
    """Attach stops, yields and lights without a lane to the lanes at their stop lines.

    A light that is in no regulatory element belongs to the nearest stop line that is in none.

    Args:
        rules: of the map.
        lanes: all lanes.
        map_file: the map.
        lines: (P, 2) points of every way, m.
    """
    named = {m.ref for r in map_file.of_type("regulatory_element").values() for m in r.members}
    bare = [i for i in _of_type(map_file, "traffic_light", lines) if i not in named]
    free = {i: lines[i] for i in _of_type(map_file, "stop_line", lines) if i not in named}
    loose = [r for r in rules if r.kind in _STOPS and not r.lanes and not r.yielding]
    if not loose and not bare:
        return Attached(rules=tuple(rules), found=(), lost=())
    drivable = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    done: dict[int, Regulation] = {}
    for rule in [*loose, *_bare_lights(bare, free, lines)]:
        stops = rule.stop_lines or tuple(lines[i] for i in rule.lights if len(lines.get(i, ())) > 1)
        found = {i for stop in stops for i in lanes_at(stop, drivable)}
        # Where a lane ends at the line and another begins there, the first one is held.
        held = tuple(sorted(i for i in found if found.isdisjoint(drivable[i].predecessors)))
        if held:
            yielding = held if rule.kind != "traffic_light" else ()
            done[rule.element_id] = replace(rule, lanes=held, yielding=yielding)
    lost = [r.element_id for r in loose if r.kind == "traffic_light" and r.element_id not in done]
    lit = {i for rule in done.values() for i in rule.lights}
    lost += [i for i in bare if i not in lit]
    everything = {rule.element_id: rule for rule in rules} | done
    return Attached(
        rules=tuple(rule for _, rule in sorted(everything.items())),
        found=tuple(sorted(done)),
        lost=tuple(sorted(lost)),
    )


def lanes_at(stop: FloatArray, lanes: Mapping[int, Lane]) -> Iterator[int]:
    """Lanes on which a stop line holds vehicles back: those before it, or those that begin at it.

    Lanes that cross it on their way out of an intersection are not held.
    """
    across = shapely.LineString(_prolonged(stop))
    way = stop[-1] - stop[0]
    for i, lane in lanes.items():
        centre = shapely.LineString(lane.centreline)
        if centre.distance(across) > 0.05:
            continue
        length = centre.length
        s = float(centre.project(shapely.Point(shapely.shortest_line(centre, across).coords[0])))
        step = along(lane.centreline, min(s + 0.5, length)) - along(lane.centreline, max(s - 0.5, 0.0))
        slant = abs(turn(_angle(way), _angle(step)))
        if min(slant, math.pi - slant) < LEAST_RAD:
            continue
        onward = [j for j in lane.successors if j in lanes]
        if s <= length / 2:
            if lane.conflicts:
                yield i
        elif lane.conflicts:
            yield from (j for j in onward if lanes[j].conflicts)
        elif _contested(lanes, onward):
            yield i


def _contested(lanes: Mapping[int, Lane], ids: Iterable[int]) -> bool:
    """Whether other traffic crosses or joins within 30 m along some lanes."""
    stack = [(i, 0.0) for i in ids]
    while stack:
        i, start = stack.pop()
        if i not in lanes or start > AHEAD_M:
            continue
        if lanes[i].conflicts:
            return True
        end = start + max(length_of(lanes[i].centreline), 0.1)
        stack += [(j, end) for j in lanes[i].successors]
    return False


def _bare_lights(bare: Sequence[int], free: Mapping[int, FloatArray], lines: Points) -> Iterator[Regulation]:
    """A rule for each stop line in no element that has such lights near it."""
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


def _of_type(map_file: MapFile, kind: str, lines: Points) -> list[int]:
    ways = sorted(map_file.ways.items())
    return [i for i, way in ways if way.tags.get("type") == kind and len(lines.get(i, ())) > 1]


def _prolonged(stop: FloatArray) -> FloatArray:
    """A line that goes on a little at both ends."""
    way = (stop[-1] - stop[0]) / max(float(length_of(stop[[0, -1]])), 1e-6)
    result: FloatArray = stop.copy()
    result[0] -= BESIDE_M * way
    result[-1] += BESIDE_M * way
    return result


def _angle(vector: FloatArray) -> float:
    return math.atan2(vector[1], vector[0])
