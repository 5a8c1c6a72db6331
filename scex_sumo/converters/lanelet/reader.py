"""Lanelet2 maps, read by lanelet2 itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from lanelet2 import io, projection, traffic_rules

from scex_sumo.converters.formats import map_name
from scex_sumo.converters.lanelet.elements import Points, areas, markings, regulations
from scex_sumo.converters.lanelet.file import MapFile, list_ids, read_map_file, write_map_file
from scex_sumo.converters.lanelet.graph import Map, Rules, Vertex, drawn_vertices, related_lanes
from scex_sumo.converters.lanelet.joints import join_lanes
from scex_sumo.converters.lanelet.origin import map_origin, recorded_origin
from scex_sumo.converters.lanelet.projection import georeference
from scex_sumo.converters.lanelet.repair import Place, distance_m, middle, repair
from scex_sumo.converters.lanelet.stops import attach
from scex_sumo.converters.lanelet.subtypes import as_roads, unknown_subtypes
from scex_sumo.converters.lanelet.tags import COUNTRIES, lane_speed_mps, map_country, says_limit
from scex_sumo.errors import MapError, one_line
from scex_sumo.files import TemporaryFolder
from scex_sumo.geometry.polylines import bounds_cross
from scex_sumo.road import Lane, Loss, Road

FARTHEST_ORIGIN_M = 100_000.0
_LOAD_ERROR = re.compile(
    r"Error (?:parsing primitive|reading primitive with id) (-?\d+)(?: from file)?: (.*)"
)


def read_road(map_path: str | Path, *, origin: Place | None = None, country: str | None = None) -> Road:
    """Read a Lanelet2 map: every lanelet, how they connect, and the rules between them.

    Geometry and relations are Lanelet2's own: centrelines as it computes them, bounds in driving direction,
    successors, lane changes and conflicts of its routing graph under German traffic rules for cars. Heights
    are left out, but lanes more than 3 m above one another do not conflict. A lanelet that cars may drive
    both ways gives two lanes; the second has ``reverse_of`` set. Connected lanelets of unknown subtype that a
    car fits on are roads, and stops and lights that no lanelet names hold the lanes where they lie. What is
    broken in the map is mended or left out, and said in the road's notes; what is lost, in its losses.

    Args:
        map_path: an ``.osm`` file, or one packed as ``.osm.gz``.
        origin: latitude and longitude in degrees to project with (UTM); None takes that of a
            ``meta_data.csv`` near the map, 0, 0 for a map drawn there, else the map's south-west corner.
        country: whose speed limits hold where the map gives none, e.g. ``us``; None for the country that the
            map's ``region`` tags name, else Germany.

    Raises:
        MapError: the file is missing, no Lanelet2 map, far from the origin, or has no usable lanelet.
    """
    path = Path(map_path)
    map_file = read_map_file(path)
    if not map_file.of_type("lanelet"):
        raise MapError(f"{path}: no lanelets (relations with type=lanelet); name a Lanelet2 .osm map")
    drawn = map_file.of_type("lanelet").keys()
    map_file, mended = repair(map_file)
    notes = list(map_file.notes)
    origin = _origin(path, map_file, origin, notes)
    rules = traffic_rules.create(traffic_rules.Locations.Germany, traffic_rules.Participants.VehicleCar)
    lanelet_map, vertices, map_file, losses = _load(map_file, origin, rules, mended, notes)
    country = country or map_country(map_file)
    lanes = related_lanes(lanelet_map, vertices, rules, map_file, country)
    joined = join_lanes(lanes)
    lanes = joined.lanes
    _note_doubts(lanes, map_file, country, notes)
    if joined.linked:
        notes.append(f"lanelets that meet without shared points, linked: {list_ids(joined.linked)}")
    if joined.inside:
        notes.append(f"lanelets that begin within other traffic: {list_ids(joined.inside)}")
    lines = _lines(lanelet_map)
    stops = attach(regulations(map_file, lanes, lines), lanes, map_file, lines)
    if stops.found:
        notes.append(
            f"stops and lights that no lanelet names, attached where they lie: {list_ids(stops.found)}"
        )
    broken = sorted(drawn - {vertex.lanelet_id for vertex in vertices})
    losses += [Loss(kind="lanelets", why="left out, broken", elements=tuple(broken))] if broken else []
    losses += [Loss(kind="lights", why="without a lane", elements=stops.lost)] if stops.lost else []
    return Road(
        name=map_name(path),
        lanes=lanes,
        regulations=stops.rules,
        markings=markings(map_file, lines),
        areas=areas(map_file, lanes, lines),
        origin=origin,
        notes=tuple(notes),
        losses=tuple(losses),
        georeference=georeference(origin),
    )


def _note_doubts(lanes: Mapping[int, Lane], map_file: MapFile, country: str, notes: list[str]) -> None:
    """Note the lanes that are there but may not be what the map's author meant."""
    drawn = {i: lane for i, lane in lanes.items() if lane.reverse_of is None}
    crossed = [i for i, lane in drawn.items() if bounds_cross(lane.left_bound, lane.right_bound)]
    if crossed:
        notes.append(
            f"bounds cross each other or themselves, the lane's shape may be off: {list_ids(crossed)}"
        )
    relations = {i: map_file.relations[i] for i in drawn}
    unclear = [
        i for i, r in relations.items() if says_limit(r, map_file) and lane_speed_mps(r, map_file) is None
    ]
    if unclear:
        default = COUNTRIES[country].name
        notes.append(f"speed limits not understood, {default}'s default taken: {list_ids(unclear)}")


def _origin(path: Path, map_file: MapFile, origin: Place | None, notes: list[str]) -> Place:
    """Origin as given, recorded or by the map itself; the last is noted where it is arbitrary."""
    known = origin or recorded_origin(path)
    found = known or map_origin(map_file, own_corner=True)
    if known is None and found != (0.0, 0.0):
        notes.append(f"origin unknown: coordinates begin at the map's corner {found[0]:.7f},{found[1]:.7f}")
    away_m = distance_m(found, middle(map_file))
    if away_m > FARTHEST_ORIGIN_M:
        raise MapError(
            f"{path}: the map is {away_m / 1000:.0f} km away from its origin {found[0]:g},{found[1]:g}; "
            "give the origin of its coordinates: --origin LAT,LON"
        )
    return found


def _load(
    map_file: MapFile, origin: Place, rules: Rules, mended: bool, notes: list[str]
) -> tuple[Map, list[Vertex], MapFile, list[Loss]]:
    """Load the map with Lanelet2, without lanelets that its routing graph would crash on.

    Returns:
        Its map and the usable lanelets in driving direction, the file with what are roads tagged so, and the
        lanelets that nobody may use.

    Args:
        map_file: the map as mended.
        origin: to project with.
        rules: who may drive in which direction.
        mended: whether the map differs from its file.
        notes: grows by what Lanelet2 complained about and what was left out.
    """
    lanelet_map, errors = _parse(map_file, origin, mended)
    vertices = drawn_vertices(lanelet_map, rules, map_file)
    flat = {v.lanelet_id for v in vertices if not v.usable}
    unknown = unknown_subtypes((v for v in vertices if v.usable), rules, map_file)
    taken = frozenset().union(*unknown.roads.values())
    if flat or taken:
        kept = {i: relation for i, relation in map_file.relations.items() if i not in flat}
        map_file = as_roads(replace(map_file, relations=kept), taken)
        lanelet_map, errors = _parse(map_file, origin, True)
        vertices = [v for v in drawn_vertices(lanelet_map, rules, map_file) if v.usable]
    if flat:
        notes.append(f"lanelets left out, no length between their bounds: {list_ids(flat)}")
    notes += [
        f"lanelets of unknown {word} taken for roads: {list_ids(i)}" for word, i in unknown.roads.items()
    ]
    if not vertices:
        why = "; ".join(note for note in notes if note.startswith("lanelets left out"))
        raise MapError(f"{map_file.path}: no usable lanelet ({why}); mend the map in an editor, e.g. JOSM")
    notes.extend(errors)
    undriven = unknown.undriven.items()
    losses = [
        Loss(kind="lanelets", why=f"not driven, {word}", elements=tuple(sorted(i))) for word, i in undriven
    ]
    return lanelet_map, vertices, map_file, losses


def _parse(map_file: MapFile, origin: Place, mended: bool) -> tuple[Map, list[str]]:
    """Have Lanelet2 read the map's file, or a mended copy; returns its map and its complaints."""
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
    """Lanelet2's error messages, one sentence for each kind with the ids of the elements."""
    found: dict[str, set[int]] = {}
    for error in errors:
        match = _LOAD_ERROR.search(error)
        if match:
            sentence = re.sub(r"-?\d+", "N", match[2]).strip().rstrip(".!")
            found.setdefault(sentence, set()).add(int(match[1]))
    return [f"Lanelet2: {one_line(sentence)}: {list_ids(ids)}" for sentence, ids in found.items()]


def _lines(lanelet_map: Map) -> Points:
    """Every linestring and polygon of the map by id, as (P, 2) points with nothing left out, m."""
    layers = (lanelet_map.lineStringLayer, lanelet_map.polygonLayer)
    lines = {
        line.id: np.array([(p.x, p.y) for p in line]).reshape(-1, 2) for layer in layers for line in layer
    }
    return dict(sorted(lines.items()))
