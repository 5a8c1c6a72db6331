"""Lanes of a Lanelet2 map: its lanelets in driving direction, related by Lanelet2's routing graph."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lanelet2 import core, geometry, routing

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile
from scex_sumo.converters.lanelet.tags import default_speed_mps, lane_kind, lane_speed_mps
from scex_sumo.errors import MapError
from scex_sumo.geometry.polylines import mean_width_m, without_repeats
from scex_sumo.road import Lane

# lanelet2 is untyped: its maps, lanelets, rules and graphs are Any.
Map = Any
Rules = Any
_Lanelet = Any
_Graph = Any

CLEARANCE_M = 3.0  # lanes this far above one another do not conflict; bridges leave 4.5 m and more


@dataclass(frozen=True, kw_only=True, eq=False)
class Vertex:
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


def drawn_vertices(lanelet_map: Map, rules: Rules, map_file: MapFile) -> list[Vertex]:
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


def _vertex(lane_id: int, lanelet: _Lanelet) -> Vertex:
    left, right = _xy(lanelet.leftBound), _xy(lanelet.rightBound)
    # Lanelet2 reads past the end of a bound without a segment when it computes the centreline.
    centreline = _xy(lanelet.centerline) if len(left) > 1 and len(right) > 1 else np.empty((0, 2))
    return Vertex(
        lane_id=lane_id, lanelet=lanelet, lanelet_id=lanelet.id, left=left, right=right, centreline=centreline
    )


def related_lanes(
    lanelet_map: Map, vertices: list[Vertex], rules: Rules, map_file: MapFile, country: str
) -> dict[int, Lane]:
    """Lanes of all driving directions by id; the country's speed limits hold where the map gives none."""
    lanes = {v.lane_id: _lane(v, rules, map_file, country) for v in vertices}
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


def _lane(vertex: Vertex, rules: Rules, map_file: MapFile, country: str) -> Lane:
    """A lane by itself, without its relations to others."""
    relation = map_file.relations[vertex.lanelet_id]
    kind = lane_kind(relation.tags, vehicle=rules.canPass(vertex.lanelet))
    speed = lane_speed_mps(relation, map_file) or default_speed_mps(relation.tags, kind, country)
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
    graph: _Graph, vertex: Vertex, ids: dict[tuple[int, bool], int], stacked: bool
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


def _xy(line: Iterable[Any]) -> FloatArray:
    """(P, 2) points of a linestring, m; repeated points once."""
    return without_repeats(np.array([(p.x, p.y) for p in line], dtype=np.float64).reshape(-1, 2))
