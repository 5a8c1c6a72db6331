"""Reader of Lanelet2 maps, by lanelet2 itself; markings and areas, for drawing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from lanelet2 import io, projection, traffic_rules

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, one_line
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.lanelet.file import (
    Findings,
    MapFile,
    Points,
    Relation,
    list_ids,
    read_map_file,
    write_map_file,
)
from scex_sumo.converters.lanelet.lanes import (
    ROAD_WIDTH_M,
    Map,
    Rules,
    Vertex,
    as_roads,
    drawn_vertices,
    join_lanes,
    related_lanes,
    unknown_subtypes,
)
from scex_sumo.converters.lanelet.origin import Place, distance_m, map_origin, recorded_origin
from scex_sumo.converters.lanelet.projection import georeference
from scex_sumo.converters.lanelet.regulations import attach, regulations
from scex_sumo.converters.lanelet.repair import repair
from scex_sumo.converters.lanelet.tags import COUNTRIES, lane_speed_mps, map_country, says_limit
from scex_sumo.converters.naming import map_name
from scex_sumo.geometry.polylines import bounds_cross
from scex_sumo.road import Area, Lane, MapLoss, Marking, Road

MAX_FROM_ORIGIN_M = 100_000.0
_LOAD_ERROR = re.compile(
    r"Error (?:parsing primitive|reading primitive with id) (-?\d+)(?: from file)?: (.*)"
)

_NO_MARKING = {"", "virtual", "traffic_sign", "traffic_light"}


def read_road(map_path: str | Path, *, origin: Place | None = None, country: str | None = None) -> Road:
    """Read a Lanelet2 map: its lanelets, how they connect, and the rules between them.

    Centrelines, bounds, successors, lane changes and conflicts are Lanelet2's own, under German traffic rules
    for cars, with these differences:
    - Lanes more than 3 m above one another do not conflict; heights are left out.
    - A lanelet that cars may drive both ways gives two lanes; the second has ``reverse_of`` set.
    - Connected lanelets of unknown subtype that a car fits on are roads.
    - Stops and lights that no lanelet names hold the lanes at their stop lines.
    Defects are listed in the road's notes; what is lost is listed in its losses.

    Args:
        map_path: an ``.osm`` or ``.osm.gz`` file.
        origin: latitude and longitude in degrees; None looks near the map, and takes 0, 0 or its south-west
            corner.
        country: whose default speed limits apply, e.g. ``us``; None: by the ``region`` tags, else Germany.

    Raises:
        MapError: the file is missing, no Lanelet2 map, far from the origin, or has no usable lanelet.

    Example:
        >>> scex.read_road(scex.example_path("roundabout")).name
        'roundabout'
    """
    path = Path(map_path)
    map_file = read_map_file(path)
    if not map_file.of_type("lanelet"):
        raise MapError(f"{path}: no lanelets (relations with type=lanelet); name a Lanelet2 .osm map")
    drawn, unread = map_file.of_type("lanelet").keys(), map_file.unread
    map_file, mended = repair(map_file)
    notes = list(map_file.notes)
    origin = _origin(path, map_file, origin, notes)
    traffic = traffic_rules.create(traffic_rules.Locations.Germany, traffic_rules.Participants.VehicleCar)
    lanelet_map, vertices, map_file, losses = _load(map_file, origin, traffic, mended, notes)
    country = country or map_country(map_file)
    lanes = related_lanes(lanelet_map, vertices, traffic, map_file, country)
    lanes, linked, inside = join_lanes(lanes)
    lines = _lines(lanelet_map)
    rules, attached, lost = attach(regulations(map_file, lanes, lines), lanes, map_file, lines)
    doubts = _doubts(lanes, map_file, country)
    doubts.note("lanelets that meet without shared points, linked", *linked)
    doubts.note("lanelets that begin on another lane", *inside)
    doubts.note("stop lines and lights that no lanelet names, attached to the lane at their place", *attached)
    broken: tuple[int | str, ...] = (*sorted(drawn - {v.lanelet_id for v in vertices}), *unread)
    losses += [MapLoss(kind="lanelets", why="left out, broken", elements=broken)] if broken else []
    losses = [replace(loss, of=len(drawn) + len(unread)) for loss in losses]
    losses += [MapLoss(kind="lights", why="without a lane", elements=tuple(lost))] if lost else []
    return Road(
        name=map_name(path),
        lanes=lanes,
        regulations=rules,
        markings=markings(map_file, lines),
        areas=areas(map_file, lanes, lines),
        origin=origin,
        notes=(*notes, *doubts.notes()),
        losses=tuple(losses),
        georeference=georeference(origin),
    )


def _doubts(lanes: Mapping[int, Lane], map_file: MapFile, country: str) -> Findings:
    doubts = Findings()
    drawn = {i: lane for i, lane in lanes.items() if lane.reverse_of is None}
    crossed = (i for i, lane in drawn.items() if bounds_cross(lane.left_bound, lane.right_bound))
    doubts.note("bounds cross each other or themselves, the lane's shape may be off", *crossed)
    relations = {i: map_file.relations[i] for i in drawn}
    unclear = (
        i for i, r in relations.items() if says_limit(r, map_file) and lane_speed_mps(r, map_file) is None
    )
    narrow = (
        i
        for i, lane in drawn.items()
        if lane.kind == "vehicle" and not lane.subtype and lane.width_m < ROAD_WIDTH_M[0]
    )
    doubts.note(f"lanelets without subtype, under {ROAD_WIDTH_M[0]:g} m wide, taken for car lanes", *narrow)
    doubts.note(f"speed limits not understood, {COUNTRIES[country].name}'s default taken", *unclear)
    return doubts


def _origin(path: Path, map_file: MapFile, origin: Place | None, notes: list[str]) -> Place:
    if map_file.local:
        if origin not in (None, (0.0, 0.0)):
            notes.append(f"origin {origin[0]:g},{origin[1]:g} not used: the map's coordinates are local")
        return 0.0, 0.0
    known = origin or recorded_origin(path)
    origin = known or map_origin(map_file, own_corner=True)
    if known is None and origin != (0.0, 0.0):
        notes.append(f"origin unknown: coordinates begin at the map's corner {origin[0]:.7f},{origin[1]:.7f}")
    away_m = distance_m(origin, map_file.middle)
    if away_m > MAX_FROM_ORIGIN_M:
        raise MapError(
            f"{path}: the map is {away_m / 1000:.0f} km away from its origin {origin[0]:g},{origin[1]:g}; "
            "give the origin of its coordinates: --origin LAT,LON"
        )
    return origin


def _load(
    map_file: MapFile, origin: Place, rules: Rules, mended: bool, notes: list[str]
) -> tuple[Map, list[Vertex], MapFile, list[MapLoss]]:
    """Load the map with Lanelet2, without lanelets that its routing graph would crash on."""
    lanelet_map, errors = _parse(map_file, origin, mended)
    vertices = drawn_vertices(lanelet_map, rules, map_file)
    flat = {v.lanelet_id for v in vertices if not v.usable}
    roads, undriven = unknown_subtypes([v for v in vertices if v.usable], rules, map_file)
    taken = set().union(*roads.values())
    if flat or taken:
        kept = {i: relation for i, relation in map_file.relations.items() if i not in flat}
        map_file = as_roads(replace(map_file, relations=kept), taken)
        lanelet_map, errors = _parse(map_file, origin, True)
        vertices = [v for v in drawn_vertices(lanelet_map, rules, map_file) if v.usable]
    if flat:
        notes.append(f"lanelets left out, no length between their bounds: {list_ids(flat)}")
    notes += [f"lanelets of unknown {word} taken for roads: {list_ids(i)}" for word, i in roads.items()]
    if not vertices:
        why = "; ".join(note for note in notes if note.startswith("lanelets left out"))
        raise MapError(f"{map_file.path}: no usable lanelet ({why}); mend the map in an editor, e.g. JOSM")
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


def _lines(lanelet_map: Map) -> Points:
    layers = (lanelet_map.lineStringLayer, lanelet_map.polygonLayer)
    lines = {
        line.id: np.array([(p.x, p.y) for p in line]).reshape(-1, 2) for layer in layers for line in layer
    }
    return dict(sorted(lines.items()))


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
        Area(
            area_id=i,
            kind=lane.subtype or lane.kind,
            outline=np.concatenate([lane.left_bound, lane.right_bound[::-1]]),
        )
        for i, lane in lanes.items()
        if lane.kind != "vehicle"
    ]
    for relation_id, relation in map_file.of_type("multipolygon").items():
        kind = relation.tags.get("subtype", "area")
        ways = [map_file.ways[i].nodes for i in relation.refs("outer", "way") if i in map_file.ways]
        for ring in _rings(ways):
            outline = _ring_points(ring, relation, map_file, lines)
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


def _ring_points(ring: tuple[int, ...], relation: Relation, map_file: MapFile, lines: Points) -> FloatArray:
    where: dict[int, FloatArray] = {}
    for way_id in relation.refs("outer", "way"):
        if way_id in lines and len(lines[way_id]) == len(map_file.ways[way_id].nodes):
            where.update(zip(map_file.ways[way_id].nodes, lines[way_id], strict=True))
    points = [where[node] for node in ring[:-1] if node in where]
    return np.array(points, dtype=np.float64).reshape(-1, 2)
