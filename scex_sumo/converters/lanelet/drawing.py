"""Markings and areas of a Lanelet2 map, for drawing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scex_sumo.converters.lanelet.file import MapFile, Points
from scex_sumo.road import Area, Lane, Marking

_NO_MARKING = {"", "virtual", "traffic_sign", "traffic_light"}


def markings(map_file: MapFile, lines: Points) -> tuple[Marking, ...]:
    """Return the ways with a type by ascending id, without virtual ones, signs and lights."""
    drawn = []
    for way_id, way in sorted(map_file.ways.items()):
        kind = way.tags.get("type", "")
        if kind in _NO_MARKING or way.tags.get("area") == "yes" or len(lines.get(way_id, ())) < 2:
            continue
        subtype = way.tags.get("subtype", "")
        drawn.append(Marking(line_id=way_id, kind=kind, subtype=subtype, points=lines[way_id]))
    return tuple(drawn)


def areas(map_file: MapFile, lanes: Mapping[int, Lane], lines: Points) -> tuple[Area, ...]:
    """Return the areas by ascending id: non-vehicle lanelets, multipolygons' outlines, ways with area=yes."""
    drawn = [
        Area(area_id=i, kind=lane.subtype or lane.kind, outline=lane.outline)
        for i, lane in lanes.items()
        if lane.kind != "vehicle"
    ]
    for relation_id, relation in map_file.of_type("multipolygon").items():
        kind = relation.tags.get("subtype", "area")
        ways = [map_file.ways[i].nodes for i in relation.refs("outer", "way") if i in map_file.ways]
        outer = [i for i in relation.refs("outer", "way") if i in lines]
        places = {n: p for i in outer for n, p in zip(map_file.ways[i].nodes, lines[i], strict=False)}
        for ring in _rings(ways):
            outline = np.array([places[node] for node in ring[:-1] if node in places]).reshape(-1, 2)
            if len(outline) >= 3:
                drawn.append(Area(area_id=relation_id, kind=kind, outline=outline))
    for way_id, way in map_file.ways.items():
        if way.tags.get("area") == "yes" and len(lines.get(way_id, ())) >= 3:
            kind = way.tags.get("subtype") or way.tags.get("type", "area")
            drawn.append(Area(area_id=way_id, kind=kind, outline=lines[way_id]))
    return tuple(sorted(drawn, key=lambda area: area.area_id))


def _rings(parts: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
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
