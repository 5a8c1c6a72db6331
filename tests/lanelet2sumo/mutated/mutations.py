"""Example maps with the defects of maps that people really have."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.converters.lanelet.file import (
    MapFile,
    MapPoint,
    Member,
    Relation,
    Way,
    read_map_file,
    write_map_file,
)
from scex_sumo.converters.lanelet.projection import to_local
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.road import Road

EXAMPLES = Path(__file__).parents[3] / "scex_sumo" / "scenarios" / "data"
FIRST_ID = 900_000  # of what is added


def example(name: str) -> MapFile:
    """An example map as it stands in its file."""
    return read_map_file(EXAMPLES / f"{name}.osm")


def read(map_file: MapFile, folder: Path) -> Road:
    """The road of a mutated map."""
    path = folder / "mutated.osm"
    write_map_file(map_file, path)
    return read_road(path)


def renamed(map_file: MapFile, lanelets: Iterable[int], **tags: str) -> MapFile:
    """The map with other tags on some lanelets, and none that say who may use them."""
    relations = dict(map_file.relations)
    for i in lanelets:
        kept = {key: v for key, v in relations[i].tags.items() if not key.startswith("participant:")}
        relations[i] = replace(relations[i], tags={**kept, **tags})
    return replace(map_file, relations=relations)


def without(map_file: MapFile, lanelets: Iterable[int]) -> MapFile:
    """The map with some lanelets cut away."""
    gone = set(lanelets)
    return replace(map_file, relations={i: r for i, r in map_file.relations.items() if i not in gone})


def torn(map_file: MapFile, lanelet: int, shift_deg: float = 1e-6) -> MapFile:
    """The map with a lanelet on bounds of its own, moved by 0.11 m to the north: it shares no points."""
    relation = map_file.relations[lanelet]
    ways, nodes, members = dict(map_file.ways), dict(map_file.nodes), []
    for k, member in enumerate(relation.members):
        if member.role not in ("left", "right"):
            members.append(member)
            continue
        own = []
        for n, node in enumerate(ways[member.ref].nodes):
            new = FIRST_ID + 1000 * (k + 1) + n
            nodes[new] = MapPoint(lat=nodes[node].lat + shift_deg, lon=nodes[node].lon)
            own.append(new)
        ways[FIRST_ID + k] = Way(nodes=tuple(own), tags=ways[member.ref].tags)
        members.append(Member(kind="way", ref=FIRST_ID + k, role=member.role))
    relations = {**map_file.relations, lanelet: replace(relation, members=tuple(members))}
    return replace(map_file, nodes=nodes, ways=ways, relations=relations)


def lit(
    map_file: MapFile, approaches: Iterable[tuple[int, ...]], *, named: bool, element: bool = True
) -> MapFile:
    """The map with a stop line and a light at the end of each approach.

    Args:
        map_file: the map.
        approaches: lanelets side by side that one light controls.
        named: the lanelets refer to the light; otherwise only the light's element names its stop line.
        element: there is a regulatory element at all.
    """
    ways, relations = dict(map_file.ways), dict(map_file.relations)
    for k, lanelets in enumerate(approaches):
        ends = {node for i in lanelets for node in _ends(map_file, i)}
        order = sorted(ends, key=lambda n: (map_file.nodes[n].lat, map_file.nodes[n].lon))
        stop, light, rule = (FIRST_ID + 10 * k + n for n in range(3))
        ways[stop] = Way(nodes=(order[0], order[-1]), tags={"type": "stop_line"})
        ways[light] = Way(nodes=(order[0], order[-1]), tags={"type": "traffic_light"})
        if not element:
            continue
        members = tuple(
            Member(kind="way", ref=ref, role=role) for ref, role in ((light, "refers"), (stop, "ref_line"))
        )
        relations[rule] = Relation(
            members=members, tags={"type": "regulatory_element", "subtype": "traffic_light"}
        )
        for i in lanelets if named else ():
            member = Member(kind="relation", ref=rule, role="regulatory_element")
            relations[i] = replace(relations[i], members=(*relations[i].members, member))
    return replace(map_file, ways=ways, relations=relations)


def _ends(map_file: MapFile, lanelet: int) -> list[int]:
    """Last nodes of the bounds in driving direction, by the bounds' common order."""
    road = read_road(map_file.path)
    lane = road.lanes[lanelet]
    nodes = []
    for side, bound in (("left", lane.left_bound), ("right", lane.right_bound)):
        [way] = map_file.relations[lanelet].refs(side, "way")
        ids = map_file.ways[way].nodes
        places = to_local(
            np.array([(map_file.nodes[n].lat, map_file.nodes[n].lon) for n in ids]), road.origin
        )
        nodes.append(ids[int(np.hypot(*(places - bound[-1]).T).argmin())])
    return nodes
