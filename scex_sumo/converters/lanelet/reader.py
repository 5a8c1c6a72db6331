"""Reader of Lanelet2 maps, by lanelet2 itself; their markings and areas, for drawing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from lanelet2 import io, projection, traffic_rules

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import MapError, one_line
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.lanelet import tags
from scex_sumo.converters.lanelet.file import (
    Findings,
    MapFile,
    Points,
    list_ids,
    read_map_file,
    write_map_file,
)
from scex_sumo.converters.lanelet.lanes import (
    MIN_ROAD_M,
    Map,
    Rules,
    Vertex,
    drawn_vertices,
    join_lanes,
    missing_lanelets,
    related_lanes,
    unknown_subtypes,
)
from scex_sumo.converters.lanelet.origin import META_DATA, Place, recorded_origin
from scex_sumo.converters.lanelet.projection import STRAY_M, distance_m, georeference
from scex_sumo.converters.lanelet.regulations import attach, regulations
from scex_sumo.converters.lanelet.repair import extended, repair
from scex_sumo.converters.naming import map_name
from scex_sumo.geometry.bounds import bounds_cross
from scex_sumo.road import Area, Lane, MapLoss, Marking, Road
from scex_sumo.roads.side import DEAD_ENDS, dead_ends, side_of

_NO_MARKING = {"", "virtual", "traffic_sign", "traffic_light"}
MAX_FROM_ORIGIN_M = 100_000.0
NEAR_ZERO_M = 50_000.0  # INTERACTION maps lie about 1 km off 0,0 at sea; no real road does
_LOAD_ERROR = re.compile(
    r"Error (?:parsing primitive|reading primitive with id) (-?\d+)(?: from file)?: (.*)"
)


@checked
def read_road(map_path: str | Path, *, origin: Place | None = None, own_corner: bool = True) -> Road:
    """Read a Lanelet2 map: its lanelets, how they connect, and the rules between them.

    Centrelines, bounds, successors, lane changes and conflicts are Lanelet2's own, under German traffic rules
    for cars, with these differences:
    - Lanes more than 3 m above one another do not conflict; heights are left out.
    - A lanelet that cars may drive both ways gives two lanes; the second has ``reverse_of`` set.
    - Connected lanelets of unknown subtype that a car fits on are roads.
    - Stops and lights that no lanelet names hold the lanes at their stop lines.
    Defects are listed in the road's notes; what is lost is listed in its losses.

    Args:
        origin: latitude and longitude in degrees; None looks beside the map and at its coordinates.
        own_corner: whether a map without a known origin begins at its south-west corner.

    Raises:
        MapError: the map is missing, far from its origin or without a known one, or has no usable lanelet.

    Example:
        >>> scex.read_road(scex.example_path("roundabout")).name
        'roundabout'
    """
    path = Path(map_path)
    map_file = read_map_file(path)
    if not map_file.of_type("lanelet"):
        raise MapError(f"{path}: no lanelets (relations with type=lanelet); name a Lanelet2 .osm map")
    drawn, unread = map_file.of_type("lanelet").keys(), map_file.unread
    map_file = repair(map_file)
    notes = list(map_file.notes)
    origin = _origin(path, map_file, origin, own_corner, notes)
    traffic = traffic_rules.create(traffic_rules.Locations.Germany, traffic_rules.Participants.VehicleCar)
    lanelet_map, vertices, map_file, losses = _load(map_file, origin, traffic, notes)
    region = tags.map_country(map_file)
    country = region if region in tags.COUNTRIES else tags.GERMANY
    lanes = related_lanes(lanelet_map, vertices, traffic, map_file, country)
    lanes, linked = join_lanes(lanes)
    layers = (lanelet_map.lineStringLayer, lanelet_map.polygonLayer)
    drawn_lines = {line.id: line for layer in layers for line in layer}
    lines = {i: np.array([(p.x, p.y) for p in drawn_lines[i]]).reshape(-1, 2) for i in sorted(drawn_lines)}
    rules, attached, lost = attach(regulations(map_file, lanes, lines), lanes, map_file, lines)
    doubts = _doubts(lanes, map_file, country)
    doubts.note("lanelets that meet without shared points, linked", *linked)
    doubts.note(DEAD_ENDS, *dead_ends(lanes))
    doubts.note("stop lines and lights that no lanelet names, attached to the lane at their place", *attached)
    broken: tuple[int | str, ...] = (*sorted(drawn - {v.lanelet_id for v in vertices}), *unread)
    losses += [MapLoss(kind="lanelets", why="left out, broken", elements=broken)] if broken else []
    losses = [replace(loss, of=len(drawn) + len(unread)) for loss in losses]
    losses += [MapLoss(kind="lights", why="without a lane", elements=tuple(lost))] if lost else []
    by_region = (region in tags.LEFT_HAND) if region else None
    side, unknown = side_of(lanes, by_region, tags.drives_left_at(map_file.middle))
    return Road(
        name=map_name(path),
        lanes=lanes,
        regulations=rules,
        markings=markings(map_file, lines),
        areas=areas(map_file, lanes, lines),
        origin=origin,
        notes=(*notes, *doubts.notes(), *unknown),
        losses=tuple(losses),
        georeference=None if origin == (0.0, 0.0) else georeference(origin),  # there: no real place
        left_hand=side,
    )


def _doubts(lanes: Mapping[int, Lane], map_file: MapFile, country: str) -> Findings:
    doubts, drawn = Findings(), {i: lane for i, lane in lanes.items() if lane.reverse_of is None}
    narrow = (i for i, lane in drawn.items() if lane.kind == "vehicle" and lane.width_m < MIN_ROAD_M)
    bare = (i for i in narrow if not drawn[i].subtype)
    doubts.note(f"lanelets without subtype, under {MIN_ROAD_M:g} m wide, taken for car lanes", *bare)
    crossed = (i for i, lane in drawn.items() if bounds_cross(lane.left_bound, lane.right_bound))
    doubts.note("bounds cross each other or themselves, the lane's shape may be off", *crossed)
    limits = {i: [*tags.limit_texts(map_file.relations[i], map_file)] for i in drawn}
    unclear = (i for i, texts in limits.items() if texts and not any(map(tags.speed_mps, texts)))
    doubts.note(f"speed limits not understood, {tags.COUNTRIES[country].name}'s default taken", *unclear)
    return doubts


def _origin(path: Path, map_file: MapFile, origin: Place | None, own_corner: bool, notes: list[str]) -> Place:
    if map_file.local:
        if origin not in (None, (0.0, 0.0)):
            notes.append(f"origin {origin[0]:g},{origin[1]:g} not used: the map's coordinates are local")
        return 0.0, 0.0
    known = origin or recorded_origin(path)
    origin = known or map_origin(map_file, own_corner=own_corner)
    if known is None and origin != (0.0, 0.0):
        notes.append(f"origin unknown: coordinates begin at the map's corner {origin[0]:.7f},{origin[1]:.7f}")
    away_m = distance_m(origin, map_file.middle)
    if away_m > MAX_FROM_ORIGIN_M:
        raise MapError(
            f"{path}: the map is {away_m / 1000:.0f} km away from its origin {origin[0]:g},{origin[1]:g}; "
            "give the origin of its coordinates: --origin LAT,LON"
        )
    return origin


def map_origin(map_file: MapFile, *, own_corner: bool) -> Place:
    """Return the origin by the map's coordinates: 0, 0 for local ones and near 0, 0 (INTERACTION).

    Args:
        own_corner: for others, return the south-west corner instead of an error; no tracks need to match.
    """
    centre = map_file.middle
    if map_file.local or distance_m(centre, (0.0, 0.0)) < NEAR_ZERO_M:
        return 0.0, 0.0
    if own_corner:
        near = [n for n in map_file.nodes.values() if distance_m((n.lat, n.lon), centre) <= STRAY_M]
        return min(n.lat for n in near), min(n.lon for n in near)
    raise MapError(
        f"{map_file.path}: the origin of its coordinates is not known: no {META_DATA} with originLat, "
        "originLon beside the tracks or the map; give --origin LAT,LON, as the recording's makers state it"
    )


def _load(
    map_file: MapFile, origin: Place, rules: Rules, notes: list[str]
) -> tuple[Map, list[Vertex], MapFile, list[MapLoss]]:
    """Load the map with Lanelet2, without lanelets that its routing graph would crash on."""
    lanelet_map, errors = _parse(map_file, origin, bool(map_file.notes))
    vertices = drawn_vertices(lanelet_map, rules, map_file)
    flat = {v.lanelet_id for v in vertices if not v.usable}
    usable = [v for v in vertices if v.usable]
    roads, undriven = dict[str, set[int]](), dict[str, set[int]]()
    changed = replace(map_file, relations={i: r for i, r in map_file.relations.items() if i not in flat})
    if not all(rules.canPass(v.lanelet) for v in usable):
        roads, undriven, changed = unknown_subtypes(usable, rules, map_file, changed)
    if missing := missing_lanelets(usable, rules, changed):
        changed = replace(changed, relations=changed.relations | missing)
        notes.append(f"lanelets missing between two others, added between their bounds: {list_ids(missing)}")
    if flat or roads or missing:
        map_file = changed
        lanelet_map, errors = _parse(map_file, origin, True)
        vertices = [v for v in drawn_vertices(lanelet_map, rules, map_file) if v.usable]
    if flat:
        notes.append(f"lanelets left out, no length between their bounds: {list_ids(flat)}")
    notes += [f"lanelets of unknown {word} taken for roads: {list_ids(i)}" for word, i in roads.items()]
    if not vertices:
        cause = "; ".join(note for note in notes if note.startswith("lanelets left out"))
        raise MapError(f"{map_file.path}: no usable lanelet ({cause}); mend the map in an editor, e.g. JOSM")
    notes.extend(errors)
    losses = [
        MapLoss(kind="lanelets", why=f"not driven, {word}", elements=tuple(sorted(i)))
        for word, i in undriven.items()
    ]
    return lanelet_map, vertices, map_file, losses


def _parse(map_file: MapFile, origin: Place, mended: bool) -> tuple[Map, list[str]]:
    projector = projection.UtmProjector(io.Origin(*origin))
    # Lanelet2 reads neither packed files nor paths that are not UTF-8.
    itself = str(map_file.path).endswith(".osm") and str(map_file.path).isprintable()
    try:
        if itself and not mended:
            lanelet_map, errors = io.loadRobust(str(map_file.path), projector)
        else:
            with TemporaryFolder() as folder:
                copy = Path(folder) / "mended.osm"
                write_map_file(map_file, copy)
                lanelet_map, errors = io.loadRobust(str(copy), projector)
    except RuntimeError as error:
        raise MapError(f"{map_file.path}: Lanelet2 cannot read it ({str(error).splitlines()[0]})") from None
    return lanelet_map, _complaints(errors)


def _complaints(errors: Iterable[str]) -> list[str]:
    complaints = Findings()
    for error in errors:
        match = _LOAD_ERROR.search(error)
        if match:
            sentence = re.sub(r"-?\d+", "N", match[2]).strip().rstrip(".!")
            complaints.note(f"Lanelet2: {one_line(sentence)}", int(match[1]))
    return list(complaints.notes())


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
        outer_ways = [map_file.ways[i].nodes for i in relation.refs("outer", "way") if i in map_file.ways]
        outer = [i for i in relation.refs("outer", "way") if i in lines]
        places = {n: p for i in outer for n, p in zip(map_file.ways[i].nodes, lines[i], strict=False)}
        for ring in _rings(outer_ways):
            outline = np.array([places[node] for node in ring[:-1] if node in places]).reshape(-1, 2)
            if len(outline) >= 3:
                drawn.append(Area(area_id=relation_id, kind=kind, outline=outline))
    for way_id, way in map_file.ways.items():
        if way.tags.get("area") == "yes" and len(lines.get(way_id, ())) >= 3:
            kind = way.tags.get("subtype") or way.tags.get("type", "area")
            drawn.append(Area(area_id=way_id, kind=kind, outline=lines[way_id]))
    return tuple(sorted(drawn, key=lambda area: area.area_id))


def _rings(ways: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    rings = []
    rest = [nodes for nodes in ways if len(nodes) > 1]
    while rest:
        ring = extended(rest.pop(0), rest, is_ring=True)
        if ring[0] == ring[-1] and len(ring) > 3:
            rings.append(ring)
    return rings
