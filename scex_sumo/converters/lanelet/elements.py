"""Regulations, markings and areas of a map file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile, Relation, Tags
from scex_sumo.road import Area, Lane, Marking, Regulation

Points: TypeAlias = dict[int, FloatArray]

# Ways that are no line on the ground.
_NO_MARKING = {"", "virtual", "traffic_sign", "traffic_light"}
_REGULATIONS = {"right_of_way", "all_way_stop", "traffic_light"}
_SIGN_ELEMENTS = {"traffic_sign", "stop_sign", "yield_sign", "stop", "yield", "give_way"}
_STOP_SIGNS = {"stop", "stopsign", "de206", "usr1-1", "r1-1"}
_YIELD_SIGNS = {"yield", "yieldsign", "giveway", "de205", "usr1-2", "r1-2"}


def regulations(map_file: MapFile, lanes: Mapping[int, Lane], lines: Points) -> tuple[Regulation, ...]:
    """Right of way, stops and lights of a map, by ascending id.

    Args:
        map_file: the map.
        lanes: the usable lanes; others are not named in the result.
        lines: (P, 2) points of every way, m.
    """
    users: dict[int, list[int]] = {}
    for lane_id in (i for i in lanes if i in map_file.relations):
        for ref in map_file.relations[lane_id].refs("regulatory_element", "relation"):
            users.setdefault(ref, []).append(lane_id)
    found = []
    for element_id, element in map_file.of_type("regulatory_element").items():
        kind = _kind(element, _signs(element, map_file))
        if kind is not None:
            named = users.get(element_id, [])
            found.append(_regulation(element_id, element, kind, named, lanes, lines, map_file))
    return tuple(found)


def _regulation(
    element_id: int,
    element: Relation,
    kind: str,
    users: list[int],
    lanes: Mapping[int, Lane],
    lines: Points,
    map_file: MapFile,
) -> Regulation:
    """One regulation; signs and lines are told apart by their type, for maps that swap their roles."""
    yielding = [i for i in element.refs("yield", "relation") if i in lanes]
    if kind in ("stop", "yield", "all_way_stop"):
        yielding += [i for i in users if i not in yielding]
    ways = _ways(element, ("refers", "ref_line", "stop_line"), map_file)
    told = {"traffic_sign", "traffic_light"}
    stop_lines = [
        i
        for i, (role, tags) in ways.items()
        if tags.get("type") not in told and (role != "refers" or "traffic_sign" in _types(ways, "ref_line"))
    ]
    lights = [i for i, (_, tags) in ways.items() if tags.get("type") == "traffic_light"]
    lights = lights or [i for i, (role, _) in ways.items() if role == "refers"]
    return Regulation(
        element_id=element_id,
        kind=kind,
        lanes=tuple(users),
        yielding=tuple(yielding),
        priority=tuple(i for i in element.refs("right_of_way", "relation") if i in lanes),
        stop_lines=tuple(lines[i] for i in stop_lines if i in lines and len(lines[i]) > 1),
        lights=tuple(lights) if kind == "traffic_light" else (),
        signs=_signs(element, map_file),
    )


_TaggedWays: TypeAlias = dict[int, tuple[str, Tags]]


def _ways(element: Relation, roles: tuple[str, ...], map_file: MapFile) -> _TaggedWays:
    """Role and tags of an element's ways, by id, in the file's order."""
    members = [m for m in element.members if m.kind == "way" and m.role in roles and m.ref in map_file.ways]
    return {m.ref: (m.role, map_file.ways[m.ref].tags) for m in members}


def _types(ways: _TaggedWays, role: str) -> set[str]:
    return {tags.get("type", "") for r, tags in ways.values() if r == role}


def _signs(element: Relation, map_file: MapFile) -> tuple[str, ...]:
    """Types of the signs that an element names, as written: its own ``sign_type``, its ways' subtypes."""
    ways = _ways(element, ("refers", "ref_line"), map_file).values()
    signs = [tags.get("subtype", "") for _, tags in ways if tags.get("type") == "traffic_sign"]
    return tuple(sign for sign in [element.tags.get("sign_type", ""), *signs] if sign)


def _kind(element: Relation, signs: Iterable[str]) -> str | None:
    """Kind of a regulatory element, or None where it regulates no right of way."""
    subtype = element.tags.get("subtype", "")
    if subtype in _REGULATIONS:
        return subtype
    if subtype not in _SIGN_ELEMENTS:
        return None
    words = {sign.lower().replace("_", "") for sign in (*signs, subtype)}
    if words & _STOP_SIGNS:
        return "stop"
    return "yield" if words & _YIELD_SIGNS else None


def markings(map_file: MapFile, lines: Points) -> tuple[Marking, ...]:
    """Lines to draw, by ascending id: every way with a type, without virtual ones, signs and lights."""
    found = []
    for way_id, way in sorted(map_file.ways.items()):
        kind = way.tags.get("type", "")
        if kind in _NO_MARKING or way.tags.get("area") == "yes" or len(lines.get(way_id, ())) < 2:
            continue
        subtype = way.tags.get("subtype", "")
        found.append(Marking(line_id=way_id, kind=kind, subtype=subtype, points=lines[way_id]))
    return tuple(found)


def areas(map_file: MapFile, lanes: Mapping[int, Lane], lines: Points) -> tuple[Area, ...]:
    """Regions to draw, by ascending id: non-vehicle lanelets, multipolygons' outlines, ways with area=yes."""
    found = [
        Area(area_id=i, kind=lane.subtype or lane.kind, outline=_outline(lane))
        for i, lane in lanes.items()
        if lane.kind != "vehicle"
    ]
    for relation_id, relation in map_file.of_type("multipolygon").items():
        kind = relation.tags.get("subtype", "area")
        for ring in _rings(
            [map_file.ways[i].nodes for i in relation.refs("outer", "way") if i in map_file.ways]
        ):
            outline = _ring_points(ring, relation, map_file, lines)
            if len(outline) >= 3:
                found.append(Area(area_id=relation_id, kind=kind, outline=outline))
    for way_id, way in map_file.ways.items():
        if way.tags.get("area") == "yes" and len(lines.get(way_id, ())) >= 3:
            kind = way.tags.get("subtype") or way.tags.get("type", "area")
            found.append(Area(area_id=way_id, kind=kind, outline=lines[way_id]))
    return tuple(sorted(found, key=lambda area: area.area_id))


def _outline(lane: Lane) -> FloatArray:
    return np.concatenate([lane.left_bound, lane.right_bound[::-1]])


def _rings(parts: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Join node sequences end to end into closed rings; what does not close is left out."""
    rings = []
    rest = [part for part in parts if len(part) > 1]
    while rest:
        ring = rest.pop(0)
        while ring[0] != ring[-1]:
            step = next((p for p in rest if ring[-1] in (p[0], p[-1])), None)
            if step is None:
                break
            rest.remove(step)
            ring = ring + (step[1:] if step[0] == ring[-1] else step[-2::-1])
        if ring[0] == ring[-1] and len(ring) > 3:
            rings.append(ring)
    return rings


def _ring_points(ring: tuple[int, ...], relation: Relation, map_file: MapFile, lines: Points) -> FloatArray:
    """(P, 2) outline of a ring of nodes, m, its first point not repeated."""
    where: dict[int, FloatArray] = {}
    for way_id in relation.refs("outer", "way"):
        if way_id in lines and len(lines[way_id]) == len(map_file.ways[way_id].nodes):
            where.update(zip(map_file.ways[way_id].nodes, lines[way_id], strict=True))
    points = [where[node] for node in ring[:-1] if node in where]
    return np.array(points, dtype=np.float64).reshape(-1, 2)
