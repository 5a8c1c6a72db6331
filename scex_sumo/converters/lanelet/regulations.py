"""Right of way, stops and traffic lights of a map file, attached to lanes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

from scex_sumo.converters.lanelet.file import MapFile, Points, Relation, Tags
from scex_sumo.road import Lane, Regulation

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


def unnamed(
    rules: Sequence[Regulation], map_file: MapFile, lines: Points
) -> tuple[list[Regulation], list[int]]:
    """Return the stops, yields and lights that no lanelet names, and the lights that no element names."""
    members = elements_members(map_file)
    bare = [i for i in ways_of_type(map_file, "traffic_light", lines) if i not in members]
    return [r for r in rules if r.kind in _STOPS and not r.lanes and not r.yielding], bare


def elements_members(map_file: MapFile) -> set[int]:
    """Return the ids of all members of regulatory elements."""
    return {m.ref for r in map_file.of_type("regulatory_element").values() for m in r.members}


def ways_of_type(map_file: MapFile, kind: str, lines: Points) -> list[int]:
    """Return the ways of a type that are lines, by ascending id."""
    ways = sorted(map_file.ways.items())
    return [i for i, way in ways if way.tags.get("type") == kind and len(lines.get(i, ())) > 1]
