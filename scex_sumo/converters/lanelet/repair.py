"""Repair of a map file before Lanelet2 reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from scex_sumo.converters.lanelet.file import Findings, MapFile, MapPoint, Member, Relation, Way, free_ids
from scex_sumo.converters.lanelet.projection import STRAY_M, distance_m

SIDES = ("left", "right")


def repair(map_file: MapFile) -> MapFile:
    """Repair or leave out what Lanelet2 would drop, misread or crash on.

    - Nodes over 50 km from the map's middle and references to missing elements are dropped.
    - Ways that end at one place end in one node.
    - Bounds in pieces are joined; lanelets without two bounds are left out.

    A map without notes is as in its file.
    """
    findings = Findings()
    centre = map_file.middle
    stray = {i for i, n in map_file.nodes.items() if distance_m((n.lat, n.lon), centre) > STRAY_M}
    findings.note("nodes over 50 km away from the map, left out", *stray)
    map_file = replace(map_file, nodes={i: n for i, n in map_file.nodes.items() if i not in stray})
    map_file = replace(map_file, ways=_joined_ends(map_file, _ways(map_file, findings), findings))
    lanelets, joined = _lanelets(map_file, findings)
    others = {i: r for i, r in map_file.relations.items() if r.tags.get("type") != "lanelet"}
    map_file = replace(map_file, ways={**map_file.ways, **joined}, relations={**others, **lanelets})
    map_file = replace(map_file, relations=_members(map_file, findings))
    return replace(map_file, notes=(*map_file.notes, *findings.notes()))


def _ways(map_file: MapFile, findings: Findings) -> dict[int, Way]:
    known, ways = map_file.nodes.keys(), {}
    members = [m for r in map_file.of_type("lanelet").values() for m in r.members]
    borders = {m.ref for m in members if m.role in (*SIDES, "centerline")}
    for i, way in map_file.ways.items():
        if not known >= set(way.nodes):
            way = replace(way, nodes=tuple(n for n in way.nodes if n in known))
            findings.note("ways that refer to missing nodes, drawn without them", i)
        if not way.nodes:
            findings.note("ways without a node, left out", i)
            continue
        if i in borders and way.tags.get("area") in ("yes", "true", "1"):
            way = replace(way, tags={k: v for k, v in way.tags.items() if k != "area"})
            findings.note("bounds tagged area=yes, taken as lines", i)
        ways[i] = way
    return ways


def _joined_ends(map_file: MapFile, ways: Mapping[int, Way], findings: Findings) -> dict[int, Way]:
    """Return the ways with one node for all ends at one place, and without steps of zero length."""
    ends = {node: map_file.nodes[node] for way in ways.values() for node in (way.nodes[0], way.nodes[-1])}
    first: dict[MapPoint, int] = {}
    merged = {node: first.setdefault(place, node) for node, place in ends.items()}
    twins = {node for node, kept in merged.items() if node != kept}
    findings.note("nodes at the place of another, taken for that one", *twins)
    result = {}
    for i, way in ways.items():
        nodes = tuple(merged.get(node, node) for node in way.nodes)
        places = [map_file.nodes[node] for node in nodes]
        inner = range(1, len(nodes) - 1)
        steps = [nodes[k] for k in inner if places[k] != places[k + 1] and places[k] != places[0]]
        kept = (nodes[0], *steps, *nodes[1:][-1:])
        if len(kept) < len(nodes):
            findings.note("ways with a point twice in a row, taken once", i)
        result[i] = replace(way, nodes=kept) if kept != way.nodes else way
    return result


def _lanelets(map_file: MapFile, findings: Findings) -> tuple[dict[int, Relation], dict[int, Way]]:
    lanelets: dict[int, Relation] = {}
    joined: dict[int, Way] = {}
    drawn: set[tuple[int, int, str]] = set()
    new_ids = free_ids((*map_file.ways, *map_file.relations, *map_file.nodes))
    for i, lanelet in map_file.of_type("lanelet").items():
        bounds = []
        for side in SIDES:
            pieces = [ref for ref in lanelet.refs(side, "way") if ref in map_file.ways]
            nodes = _chain([map_file.ways[ref].nodes for ref in pieces])
            if nodes is None or not _is_line(nodes, map_file):
                findings.note(
                    "lanelets left out, their bounds are missing, in pieces or shorter than two points", i
                )
                break
            if len(pieces) > 1:
                findings.note("lanelets with bounds in several pieces, joined", i)
                way = Way(nodes=nodes, tags=map_file.ways[pieces[0]].tags)
                pieces = [next(new_ids)]
                joined[pieces[0]] = way
            bounds.append(Member(kind="way", ref=pieces[0], role=side))
        if len(bounds) < 2:
            continue
        if bounds[0].ref == bounds[1].ref:
            findings.note("lanelets left out, one way is both their bounds", i)
            continue
        if (bound_ids := (bounds[0].ref, bounds[1].ref, lanelet.tags.get("subtype", ""))) in drawn:
            findings.note("lanelets left out, drawn twice between the same bounds", i)
            continue
        drawn.add(bound_ids)
        lanelets[i] = replace(lanelet, members=(*bounds, *_other_members(i, lanelet, map_file, findings)))
    return lanelets, joined


def _other_members(i: int, lanelet: Relation, map_file: MapFile, findings: Findings) -> list[Member]:
    rest = [m for m in lanelet.members if m.role not in SIDES]
    centres = [m for m in rest if m.role == "centerline"]
    if not centres:
        return rest
    way = map_file.ways.get(centres[0].ref) if centres[0].kind == "way" else None
    if len(centres) == 1 and way is not None and _is_line(way.nodes, map_file):
        sides = [map_file.ways[m.ref] for m in lanelet.members if m.role in SIDES and m.ref in map_file.ways]
        if all(side.nodes not in (way.nodes, way.nodes[::-1]) for side in sides):
            return rest
    findings.note("lanelets with a broken centreline, computed from their bounds", i)
    return [m for m in rest if m.role != "centerline"]


def _is_line(nodes: tuple[int, ...], map_file: MapFile) -> bool:
    return len({(map_file.nodes[n].lat, map_file.nodes[n].lon) for n in nodes}) > 1


def _chain(pieces: list[tuple[int, ...]]) -> tuple[int, ...] | None:
    """Join node sequences of any order and direction end to end; returns None if they do not chain."""
    rest = [piece for piece in pieces if len(piece) > 1]
    if not rest:
        return None
    line = extended(extended(rest.pop(0), rest)[::-1], rest)[::-1]
    return None if rest else line


def extended(line: tuple[int, ...], rest: list[tuple[int, ...]], *, is_ring: bool = False) -> tuple[int, ...]:
    """Move node sequences of ``rest`` to the end of another, until none fits or a ring is closed."""
    while not (is_ring and line[0] == line[-1]):
        piece = next((p for p in rest if line[-1] in (p[0], p[-1])), None)
        if piece is None:
            break
        rest.remove(piece)
        line += piece[1:] if piece[0] == line[-1] else piece[-2::-1]
    return line


def _members(map_file: MapFile, findings: Findings) -> dict[int, Relation]:
    known: dict[str, Mapping[int, object]]
    known = {"node": map_file.nodes, "way": map_file.ways, "relation": map_file.relations}
    relations = {}
    for i, relation in map_file.relations.items():
        members = tuple(m for m in relation.members if m.ref in known[m.kind])
        kind = relation.tags.get("type")
        if len(members) < len(relation.members):
            if kind == "multipolygon":
                findings.note("areas left out, part of their outline is missing", i)
                continue
            names = {"lanelet": "lanelets", "regulatory_element": "regulatory elements"}.get(kind or "")
            findings.note(f"{names or 'relations'} that refer to missing elements, used without", i)
            relation = replace(relation, members=members)
        relations[i] = relation
    return relations
