"""Lanelet2 maps, read by lanelet2 itself."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from lanelet2 import core, geometry, io, projection, routing, traffic_rules

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.elements import Points, areas, markings, regulations
from scex_sumo.converters.lanelet.file import MapFile, list_ids, read_map_file, write_map_file
from scex_sumo.converters.lanelet.origin import map_origin, recorded_origin
from scex_sumo.converters.lanelet.repair import Place, distance_m, middle, repair
from scex_sumo.converters.lanelet.tags import default_speed_mps, lane_kind, lane_speed_mps, says_limit
from scex_sumo.errors import MapError
from scex_sumo.geometry.polylines import bounds_cross, mean_width_m, without_repeats
from scex_sumo.road import Lane, Road

# lanelet2 is untyped: its maps, lanelets, rules and graphs are Any, and go no further than this module.
_Map = Any
_Lanelet = Any
_Rules = Any
_Graph = Any

FARTHEST_ORIGIN_M = 100_000.0
CLEARANCE_M = 3.0  # lanes this far above one another do not conflict; bridges leave 4.5 m and more
_LOAD_ERROR = re.compile(
    r"Error (?:parsing primitive|reading primitive with id) (-?\d+)(?: from file)?: (.*)"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Vertex:
    """One driving direction of a lanelet: a lane to be."""

    lane_id: int
    lanelet: _Lanelet
    lanelet_id: int
    left: FloatArray
    right: FloatArray
    centreline: FloatArray

    @property
    def usable(self) -> bool:
        """Whether the bounds and the centreline are finite lines."""
        lines = (self.left, self.right, self.centreline)
        return all(len(line) > 1 and bool(np.isfinite(line).all()) for line in lines)


def read_road(map_path: str | Path, *, origin: Place | None = None) -> Road:
    """Read a Lanelet2 map: every lanelet, how they connect, and the rules between them.

    Geometry and relations are Lanelet2's own: centrelines as it computes them, bounds in driving direction,
    successors, lane changes and conflicts of its routing graph under German traffic rules for cars. Heights
    are left out, but lanes more than 3 m above one another do not conflict. A lanelet that cars may drive
    both ways gives two lanes; the second has ``reverse_of`` set. What is broken in the map is mended or
    left out, and said in the road's notes.

    Args:
        map_path: an ``.osm`` file.
        origin: latitude and longitude in degrees to project with (UTM); None takes that of a
            ``meta_data.csv`` near the map, 0, 0 for a map drawn there, else the map's south-west corner.

    Raises:
        MapError: the file is missing, no Lanelet2 map, far from the origin, or has no usable lanelet.
    """
    path = Path(map_path)
    map_file = read_map_file(path)
    if not map_file.of_type("lanelet"):
        raise MapError(f"{path}: no lanelets (relations with type=lanelet); name a Lanelet2 .osm map")
    map_file, mended = repair(map_file)
    notes = list(map_file.notes)
    origin = _origin(path, map_file, origin, notes)
    rules = traffic_rules.create(traffic_rules.Locations.Germany, traffic_rules.Participants.VehicleCar)
    lanelet_map, vertices = _load(map_file, origin, rules, mended, notes)
    lanes = _lanes(lanelet_map, vertices, rules, map_file)
    _note_doubts(lanes, map_file, notes)
    lines = _lines(lanelet_map)
    return Road(
        name=path.stem,
        lanes=lanes,
        regulations=regulations(map_file, lanes, lines),
        markings=markings(map_file, lines),
        areas=areas(map_file, lanes, lines),
        origin=origin,
        notes=tuple(notes),
    )


def _note_doubts(lanes: Mapping[int, Lane], map_file: MapFile, notes: list[str]) -> None:
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
        notes.append(f"speed limits not understood, Germany's default taken: {list_ids(unclear)}")


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
    map_file: MapFile, origin: Place, rules: _Rules, mended: bool, notes: list[str]
) -> tuple[_Map, list[_Vertex]]:
    """Load the map with Lanelet2, without lanelets that its routing graph would crash on.

    Args:
        map_file: the map as mended.
        origin: to project with.
        rules: who may drive in which direction.
        mended: whether the map differs from its file.
        notes: grows by what Lanelet2 complained about and what was left out.
    """
    lanelet_map, errors = _parse(map_file, origin, mended)
    vertices = _vertices(lanelet_map, rules, map_file)
    flat = {v.lanelet_id for v in vertices if not v.usable}
    if flat:
        notes.append(f"lanelets left out, no length between their bounds: {list_ids(flat)}")
        kept = {i: relation for i, relation in map_file.relations.items() if i not in flat}
        lanelet_map, errors = _parse(replace(map_file, relations=kept), origin, True)
        vertices = [v for v in _vertices(lanelet_map, rules, map_file) if v.usable]
    if not vertices:
        why = "; ".join(note for note in notes if note.startswith("lanelets left out"))
        raise MapError(f"{map_file.path}: no usable lanelet ({why}); mend the map in an editor, e.g. JOSM")
    notes.extend(errors)
    return lanelet_map, vertices


def _parse(map_file: MapFile, origin: Place, mended: bool) -> tuple[_Map, list[str]]:
    """Have Lanelet2 read the map's file, or a mended copy; returns its map and its complaints."""
    projector = projection.UtmProjector(io.Origin(*origin))
    try:
        if not mended:
            lanelet_map, errors = io.loadRobust(str(map_file.path), projector)
        else:
            with tempfile.TemporaryDirectory(prefix="scex-sumo-") as folder:
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
    return [f"Lanelet2: {sentence}: {list_ids(ids)}" for sentence, ids in found.items()]


def _xy(line: Iterable[Any]) -> FloatArray:
    """(P, 2) points of a linestring, m; repeated points once."""
    return without_repeats(np.array([(p.x, p.y) for p in line], dtype=np.float64).reshape(-1, 2))


def _lines(lanelet_map: _Map) -> Points:
    """Every linestring and polygon of the map by id, as (P, 2) points with nothing left out, m."""
    layers = (lanelet_map.lineStringLayer, lanelet_map.polygonLayer)
    lines = {
        line.id: np.array([(p.x, p.y) for p in line]).reshape(-1, 2) for layer in layers for line in layer
    }
    return dict(sorted(lines.items()))


def _vertices(lanelet_map: _Map, rules: _Rules, map_file: MapFile) -> list[_Vertex]:
    """Driving directions of all lanelets, by ascending id; two for lanelets that cars drive both ways."""
    lanelets = {lanelet.id: lanelet for lanelet in lanelet_map.laneletLayer}
    vertices = []
    free_id = max(map(abs, (*map_file.relations, *lanelets)), default=0) + 1
    for i in sorted(lanelets.keys() & map_file.relations.keys()):
        lanelet = lanelets[i]
        vertices.append(_vertex(i, lanelet))
        if vertices[-1].usable and rules.canPass(lanelet) and rules.canPass(lanelet.invert()):
            vertices.append(replace(_vertex(free_id, lanelet.invert()), lanelet_id=i))
            free_id += 1
    return vertices


def _vertex(lane_id: int, lanelet: _Lanelet) -> _Vertex:
    left, right = _xy(lanelet.leftBound), _xy(lanelet.rightBound)
    # Lanelet2 reads past the end of a bound without a segment when it computes the centreline.
    centreline = _xy(lanelet.centerline) if len(left) > 1 and len(right) > 1 else np.empty((0, 2))
    return _Vertex(
        lane_id=lane_id, lanelet=lanelet, lanelet_id=lanelet.id, left=left, right=right, centreline=centreline
    )


def _lanes(lanelet_map: _Map, vertices: list[_Vertex], rules: _Rules, map_file: MapFile) -> dict[int, Lane]:
    """Lanes of all driving directions by id."""
    lanes = {v.lane_id: _lane(v, rules, map_file) for v in vertices}
    # Distance alone as cost: travel time would ask for speeds, and fails on signs Lanelet2 does not know.
    try:
        graph = routing.RoutingGraph(lanelet_map, rules, [routing.RoutingCostDistance(1.0)])
    except RuntimeError as error:
        raise MapError(f"{map_file.path}: Lanelet2 finds no routes in it ({error})") from None
    ids = {
        (v.lanelet_id, v.lanelet.inverted()): v.lane_id
        for v in vertices
        if lanes[v.lane_id].kind == "vehicle"
    }
    stacked = np.ptp([node.ele for node in map_file.nodes.values()]) > CLEARANCE_M
    for v in vertices:
        if lanes[v.lane_id].kind == "vehicle":
            relations = _relations(graph, v, ids, bool(stacked))
            lanes[v.lane_id] = replace(lanes[v.lane_id], **relations)
    return lanes


def _lane(vertex: _Vertex, rules: _Rules, map_file: MapFile) -> Lane:
    """A lane by itself, without its relations to others."""
    relation = map_file.relations[vertex.lanelet_id]
    kind = lane_kind(relation.tags, vehicle=rules.canPass(vertex.lanelet))
    speed = lane_speed_mps(relation, map_file) or default_speed_mps(relation.tags, kind)
    return Lane(
        lane_id=vertex.lane_id,
        centreline=vertex.centreline,
        left_bound=vertex.left,
        right_bound=vertex.right,
        width_m=mean_width_m(vertex.left, vertex.right),
        speed_limit_mps=speed,
        kind=kind,
        subtype=relation.tags.get("subtype", ""),
        location=relation.tags.get("location", ""),
        reverse_of=vertex.lanelet_id if vertex.lane_id != vertex.lanelet_id else None,
    )


def _relations(
    graph: _Graph, vertex: _Vertex, ids: dict[tuple[int, bool], int], stacked: bool
) -> dict[str, Any]:
    """How the routing graph connects a lane to others."""

    def lane_ids(found: Iterable[Any]) -> tuple[int, ...]:
        lanelets = [other for other in found if isinstance(other, core.ConstLanelet)]  # areas are no lanes
        keys = {(other.id, other.inverted()) for other in lanelets}
        return tuple(sorted(ids[key] for key in keys if key in ids))

    def lane_id(found: _Lanelet | None) -> int | None:
        return next(iter(lane_ids([found] if found else [])), None)

    lanelet = vertex.lanelet
    left, right = lane_id(graph.left(lanelet)), lane_id(graph.right(lanelet))
    conflicting = [
        other
        for other in graph.conflicting(lanelet)
        # A two-way lanelet's own other direction is no crossing; see Lane.reverse_of.
        if other.id != vertex.lanelet_id and not (stacked and not _on_one_level(lanelet, other))
    ]
    return {
        "successors": lane_ids(graph.following(lanelet)),
        "predecessors": lane_ids(graph.previous(lanelet)),
        "left": left,
        "right": right,
        "adjacent_left": left if left is not None else lane_id(graph.adjacentLeft(lanelet)),
        "adjacent_right": right if right is not None else lane_id(graph.adjacentRight(lanelet)),
        "conflicts": lane_ids(conflicting),
    }


def _on_one_level(lanelet: _Lanelet, other: _Lanelet) -> bool:
    # Lanelet2 measures heights along the first: ask both ways.
    return any(geometry.overlaps3d(a, b, CLEARANCE_M) for a, b in ((lanelet, other), (other, lanelet)))
