"""Lanelet2 maps: the one module that imports lanelet2."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lanelet2 import core, io, projection, routing, traffic_rules

from scex_sumo.converters.lanelet_tags import lane_kind, regulated_speed_mps, tagged_speed_mps
from scex_sumo.converters.map_elements import Points, areas, markings, regulations
from scex_sumo.converters.map_file import MapFile, list_ids, read_map_file
from scex_sumo.converters.origin import find_origin
from scex_sumo.errors import MapError
from scex_sumo.road import Lane, Road
from scex_sumo.scene import FloatArray

# lanelet2 is untyped: its lanelets and graph are Any here and go no further than this module.
_Lanelet = Any
_Graph = Any


def read_road(map_path: str | Path, *, origin: tuple[float, float] | None = None) -> Road:
    """Read a Lanelet2 map: every lanelet, how they connect, and the rules between them.

    Geometry and relations are Lanelet2's own: centrelines as it computes them, bounds in driving direction,
    successors, lane changes and conflicts of its routing graph under German traffic rules for vehicles.

    Args:
        map_path: an ``.osm`` file.
        origin: latitude and longitude in degrees to project with (UTM); None looks for it as
            ``find_origin`` does and falls back on the map's south-west corner, which a note then says.

    Raises:
        MapError: the file is missing, not a Lanelet2 map, or has no usable lanelet.
    """
    path = Path(map_path)
    map_file = read_map_file(path)
    if not map_file.of_type("lanelet"):
        raise MapError(f"{path}: no lanelets (relations with type=lanelet); name a Lanelet2 .osm map")
    origin = find_origin(path, origin=origin, own_corner=True)
    lanelet_map, errors = _load(path, origin)
    lanelets = {lanelet.id: lanelet for lanelet in lanelet_map.laneletLayer}
    lanelets = dict(sorted(lanelets.items()))
    geometry = {i: _geometry(lanelet) for i, lanelet in lanelets.items()}
    broken = [i for i, (left, right, _) in geometry.items() if len(left) < 2 or len(right) < 2]
    notes = [*map_file.notes, *errors]
    if broken:
        notes.append(f"left out, no two bounds of two points: {list_ids(broken)}")
        lanelets = {i: lanelet for i, lanelet in lanelets.items() if i not in broken}
        lanelet_map = core.createMapFromLanelets(list(lanelets.values()))
    lines = _lines(lanelet_map)
    lanes = _lanes(lanelet_map, lanelets, geometry, map_file)
    return Road(
        name=path.stem,
        lanes=lanes,
        regulations=regulations(map_file, lanes, lines),
        markings=markings(map_file, lines),
        areas=areas(map_file, lanes, lines),
        origin=origin,
        notes=tuple(notes),
    )


def _load(path: Path, origin: tuple[float, float]) -> tuple[Any, list[str]]:
    """Load the map with Lanelet2; returns it and what Lanelet2 complained about."""
    try:
        lanelet_map, errors = io.loadRobust(str(path), projection.UtmProjector(io.Origin(*origin)))
    except RuntimeError as error:
        raise MapError(f"{path}: Lanelet2 cannot read it ({str(error).splitlines()[0]})") from None
    return lanelet_map, [error.strip("\t -") for error in errors[1:]]


def _xy(line: Iterable[Any]) -> FloatArray:
    """(P, 2) points of a linestring, m; each point once in a row."""
    points = np.array([(p.x, p.y) for p in line], dtype=np.float64).reshape(-1, 2)
    if len(points) > 1:
        new = np.ones(len(points), dtype=bool)
        new[1:] = np.any(points[1:] != points[:-1], axis=1)
        points = points[new]
    return points


def _geometry(lanelet: _Lanelet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Left bound, right bound and centreline of a lanelet, in driving direction."""
    left, right = _xy(lanelet.leftBound), _xy(lanelet.rightBound)
    if len(left) < 2 or len(right) < 2:
        return left, right, np.empty((0, 2))
    return left, right, _xy(lanelet.centerline)


def _lines(lanelet_map: Any) -> Points:
    lines = {line.id: _xy(line) for line in lanelet_map.lineStringLayer}
    lines.update((polygon.id, _xy(polygon)) for polygon in lanelet_map.polygonLayer)
    return lines


def _lanes(
    lanelet_map: Any,
    lanelets: Mapping[int, _Lanelet],
    geometry: Mapping[int, tuple[FloatArray, FloatArray, FloatArray]],
    map_file: MapFile,
) -> dict[int, Lane]:
    germany, who = traffic_rules.Locations.Germany, traffic_rules.Participants
    rules = traffic_rules.create(germany, who.Vehicle)
    bicycle, pedestrian = (
        traffic_rules.create(germany, who.Bicycle),
        traffic_rules.create(germany, who.Pedestrian),
    )
    graph = routing.RoutingGraph(lanelet_map, rules)
    vehicles = {i for i, lanelet in lanelets.items() if rules.canPass(lanelet)}
    lanes = {}
    for i, lanelet in lanelets.items():
        tags = map_file.relations[i].tags
        left, right, centreline = geometry[i]
        on_foot, by_bicycle = pedestrian.canPass(lanelet), bicycle.canPass(lanelet)
        kind = lane_kind(tags, vehicle=i in vehicles, bicycle=by_bicycle, pedestrian=on_foot)
        mine = {"vehicle": rules, "bicycle": bicycle, "pedestrian": pedestrian}.get(kind, rules)
        default_mps = mine.speedLimit(lanelet).speedLimitMPS
        lanes[i] = Lane(
            lane_id=i,
            centreline=centreline,
            left_bound=left,
            right_bound=right,
            width_m=_width(left, right),
            speed_limit_mps=regulated_speed_mps(i, map_file) or tagged_speed_mps(tags) or default_mps,
            kind=kind,
            subtype=tags.get("subtype", ""),
            location=tags.get("location", ""),
            **(_relations(graph, lanelet, vehicles) if i in vehicles else {}),
        )
    return lanes


def _relations(graph: _Graph, lanelet: _Lanelet, vehicles: set[int]) -> dict[str, Any]:
    """How the routing graph connects a vehicle lanelet to others."""
    left, right = graph.left(lanelet), graph.right(lanelet)
    return {
        "successors": _ids(graph.following(lanelet), vehicles),
        "predecessors": _ids(graph.previous(lanelet), vehicles),
        "left": left.id if left else None,
        "right": right.id if right else None,
        "adjacent_left": _id(left or graph.adjacentLeft(lanelet)),
        "adjacent_right": _id(right or graph.adjacentRight(lanelet)),
        "conflicts": _ids(graph.conflicting(lanelet), vehicles - {lanelet.id}),
    }


def _ids(found: Iterable[Any], among: set[int]) -> tuple[int, ...]:
    return tuple(sorted({other.id for other in found} & among))


def _id(lanelet: _Lanelet | None) -> int | None:
    return lanelet.id if lanelet else None


def _width(left: FloatArray, right: FloatArray) -> float:
    """Mean distance of the bounds, m: the area between them over the mean of their lengths."""
    ring = np.concatenate([left, right[::-1]])
    x, y = (ring - ring[0]).T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    length = sum(float(np.hypot(*np.diff(bound, axis=0).T).sum()) for bound in (left, right)) / 2
    return area / length if length > 0 else 0.0
