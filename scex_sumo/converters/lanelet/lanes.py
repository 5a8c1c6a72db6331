"""Lanes of a Lanelet2 map, related by Lanelet2's routing graph; lanelets it lacks or does not understand.

Lanelets of unknown subtype or location are closed to all; lanelets are linked by shared end points only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lanelet2 import core, geometry, routing

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.file import MapFile, Member, Relation, free_ids
from scex_sumo.converters.lanelet.tags import default_speed_mps, lane_kind, lane_speed_mps
from scex_sumo.geometry.bounds import mean_width_m
from scex_sumo.geometry.polylines import heading, length_of, turn, without_repeats
from scex_sumo.road import Lane

MAX_LANE_M = 4.5
MAX_ROAD_M = 8.0  # of a lane for cars: wider ones are places
SAME_END_M = 0.1  # ends of bounds that coincide; one lanelet then leads into the other
_LOCATIONS = ("", "urban", "nonurban")
# Lanelet2's own.
_KNOWN_SUBTYPES = {
    *("road", "highway", "play_street", "emergency_lane", "exit", "parking", "freespace", "vegetation"),
    *("keepout", "building", "traffic_island"),
}
_TRACKS = {"tram", "rail", "railway", "train", "subway", "light_rail"}

# lanelet2 is untyped: its maps, lanelets, rules and graphs are Any.
Map = Any
Rules = Any
_Lanelet = Any
_Graph = Any

MIN_LENGTH_M = 0.01  # of lanes in the net
MIN_HEADROOM_M = 3.0  # lanes this far above one another do not conflict; bridges leave 4.5 m and more

MIN_ROAD_M = 2.2  # of a lane for cars: narrower ones are for bicycles
MISSED_JOINT_M = 0.6  # between two centrelines
ALIGNED_RAD = math.radians(15.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Vertex:
    """One driving direction of a lanelet; it becomes a lane."""

    lane_id: int
    lanelet: _Lanelet
    lanelet_id: int
    left: FloatArray
    right: FloatArray
    centreline: FloatArray

    @property
    def usable(self) -> bool:
        """Whether the bounds and the centreline are finite lines, and the lane has a length."""
        lines = (self.left, self.right, self.centreline)
        finite = all(len(line) > 1 and bool(np.isfinite(line).all()) for line in lines)
        return finite and length_of(self.centreline) >= MIN_LENGTH_M


def drawn_vertices(lanelet_map: Map, rules: Rules, map_file: MapFile) -> list[Vertex]:
    """Return the driving directions of all lanelets, by ascending id; two if cars may drive both ways."""
    lanelets = {lanelet.id: lanelet for lanelet in lanelet_map.laneletLayer}
    vertices = []
    new_ids = free_ids((*map_file.relations, *lanelets))
    for i in sorted(lanelets.keys() & map_file.relations.keys()):
        lanelet = lanelets[i]
        vertices.append(_vertex(i, lanelet))
        if vertices[-1].usable and rules.canPass(lanelet) and rules.canPass(lanelet.invert()):
            vertices.append(_vertex(next(new_ids), lanelet.invert()))
    return vertices


def _vertex(lane_id: int, lanelet: _Lanelet) -> Vertex:
    left, right = _xy(lanelet.leftBound), _xy(lanelet.rightBound)
    # Lanelet2 reads past the end of a bound without a segment when it computes the centreline.
    centreline = _xy(lanelet.centerline) if len(left) > 1 and len(right) > 1 else np.empty((0, 2))
    return Vertex(
        lane_id=lane_id, lanelet=lanelet, lanelet_id=lanelet.id, left=left, right=right, centreline=centreline
    )


def _xy(line: Iterable[Any]) -> FloatArray:
    return without_repeats(np.array([(p.x, p.y) for p in line], dtype=np.float64).reshape(-1, 2))


def related_lanes(
    lanelet_map: Map, vertices: list[Vertex], rules: Rules, map_file: MapFile, country: str
) -> dict[int, Lane]:
    """Return the lanes by id; the country's speed limits apply where the map gives none."""
    lanes = {v.lane_id: _lane(v, rules, map_file, country) for v in vertices}
    # Distance alone as cost: travel time would ask for speeds, and fails on signs Lanelet2 does not know.
    try:
        graph = routing.RoutingGraph(lanelet_map, rules, [routing.RoutingCostDistance(1.0)])
    except RuntimeError as error:
        raise MapError(f"{map_file.path}: Lanelet2 finds no routes in it ({error})") from None
    driven = [v for v in vertices if lanes[v.lane_id].kind == "vehicle"]
    ids = {(v.lanelet_id, v.lanelet.inverted()): v.lane_id for v in driven}
    stacked = bool(np.ptp([node.ele for node in map_file.nodes.values()]) > MIN_HEADROOM_M)
    for v in driven:
        lanes[v.lane_id] = replace(lanes[v.lane_id], **_relations(graph, v, ids, stacked))
    return lanes


def _lane(vertex: Vertex, rules: Rules, map_file: MapFile, country: str) -> Lane:
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
    def lane_ids(others: Iterable[Any]) -> tuple[int, ...]:
        lanelets = [other for other in others if isinstance(other, core.ConstLanelet)]  # areas are no lanes
        keys = {(other.id, other.inverted()) for other in lanelets}
        return tuple(sorted(ids[key] for key in keys if key in ids))

    def lane_id(other: _Lanelet | None) -> int | None:
        return next(iter(lane_ids([other] if other else [])), None)

    lanelet = vertex.lanelet
    left, right = lane_id(graph.left(lanelet)), lane_id(graph.right(lanelet))
    conflicting = [
        other
        for other in graph.conflicting(lanelet)
        # A two-way lanelet's own other direction is no crossing; see Lane.reverse_of.
        # Lanelet2 measures heights along the first: ask both ways.
        if other.id != vertex.lanelet_id
        and (
            not stacked
            or geometry.overlaps3d(lanelet, other, MIN_HEADROOM_M)
            or geometry.overlaps3d(other, lanelet, MIN_HEADROOM_M)
        )
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


def join_lanes(lanes: Mapping[int, Lane]) -> tuple[dict[int, Lane], set[int]]:
    """Link aligned vehicle lanes whose ends nearly meet, and move the loose end.

    At least one end must be loose, and neither may have a choice. Returns all lanes, and ids of the linked.
    """
    result = dict(lanes)
    driven = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    loose_starts = {i for i, lane in driven.items() if not lane.predecessors}
    loose_ends = {i for i, lane in driven.items() if not lane.successors}
    pairs = _missed_joints(driven, loose_starts, loose_ends) if loose_starts or loose_ends else []
    for before, after in pairs:
        _link(result, before, after, move_start=after in loose_starts)
    return result, {i for pair in pairs for i in pair}


def _missed_joints(lanes: Mapping[int, Lane], starts: set[int], ends: set[int]) -> list[tuple[int, int]]:
    ids = list(lanes)
    first = np.array([lanes[i].centreline[0] for i in ids])
    last = np.array([lanes[i].centreline[-1] for i in ids])
    pairs = []
    for k, i in enumerate(ids):
        gaps = np.hypot(*(first - last[k]).T)
        # Where their beginnings or their ends are nearer, they lie beside each other; a stub may do so whole.
        apart = np.minimum(np.hypot(*(first - first[k]).T), np.hypot(*(last - last[k]).T))
        for m in np.flatnonzero((gaps < MISSED_JOINT_M) & (gaps < apart)):
            j = ids[m]
            if (j in starts or i in ends) and _aligned(lanes[i], lanes[j]):
                pairs.append((i, j))
    befores, afters = [i for i, _ in pairs], [j for _, j in pairs]
    return [(i, j) for i, j in pairs if befores.count(i) == 1 and afters.count(j) == 1]


def _aligned(before: Lane, after: Lane) -> bool:
    bent = turn(heading(before.centreline, end=True), heading(after.centreline, end=False))
    alike = 0.6 < before.width_m / max(after.width_m, 0.1) < 1.7
    return abs(bent) < ALIGNED_RAD and alike and before.reverse_of != after.lane_id != before.lane_id


def _link(lanes: dict[int, Lane], before: int, after: int, *, move_start: bool) -> None:
    first, second = lanes[before], lanes[after]
    if move_start:
        second = replace(second, centreline=_begun_at(second.centreline, first.centreline[-1]))
    else:
        first = replace(first, centreline=_begun_at(first.centreline[::-1], second.centreline[0])[::-1])
    lanes[before] = replace(first, successors=tuple(sorted({*first.successors, after})))
    lanes[after] = replace(second, predecessors=tuple(sorted({*second.predecessors, before})))
    for i, j in ((before, after), (after, before)):
        lanes[i] = replace(lanes[i], conflicts=tuple(k for k in lanes[i].conflicts if k != j))


def _begun_at(line: FloatArray, start: FloatArray) -> FloatArray:
    direction = line[-1] - line[0] if len(line) == 2 else line[1] - line[0]
    ahead = line[1:][(line[1:] - start) @ direction > 1e-3]
    return np.vstack([start, ahead if len(ahead) else line[-1:]])


def unknown_subtypes(
    vertices: list[Vertex], rules: Rules, map_file: MapFile, kept: MapFile
) -> tuple[dict[str, set[int]], dict[str, set[int]], MapFile]:
    """Find the lanelets of unknown subtype or location: those that are roads, and the others.

    A road is as wide as a car needs and connected to another road.

    Returns ids of the roads, and of the others, each by the unknown tag in words; and the map ``kept`` with
    the roads tagged as such, in towns if their location is unknown.
    """
    driven = {v.lanelet_id for v in vertices if rules.canPass(v.lanelet)}
    unknown = {
        v.lanelet_id: word
        for v in vertices
        if v.lanelet_id not in driven and (word := _unknown_tag(map_file.relations[v.lanelet_id]))
    }
    wide = {
        v.lanelet_id
        for v in vertices
        if v.lanelet_id in unknown and MIN_ROAD_M <= mean_width_m(v.left, v.right) <= MAX_ROAD_M
    }
    roads = wide & _linked([v for v in vertices if v.lanelet_id in driven | wide]) if wide else wide
    relations = dict(kept.relations)
    for i in roads:
        tags = {**relations[i].tags, "subtype": "road"}
        if tags.get("location", "") not in _LOCATIONS:
            tags["location"] = "urban"
        relations[i] = replace(relations[i], tags=tags)
    by_word: tuple[dict[str, set[int]], dict[str, set[int]]] = ({}, {})
    for i in sorted(unknown):
        by_word[i not in roads].setdefault(unknown[i], set()).add(i)
    return *by_word, replace(kept, relations=relations)


def _unknown_tag(lanelet: Relation) -> str:
    subtype, location = lanelet.tags.get("subtype", ""), lanelet.tags.get("location", "")
    if lane_kind(lanelet.tags, vehicle=False) != "other" or subtype.lower() in _TRACKS:
        return ""
    if any(key.startswith("participant:") for key in lanelet.tags):
        return ""  # the map says itself who may use it
    if subtype not in _KNOWN_SUBTYPES:
        return f"subtype {subtype}" if subtype else "no subtype"
    return f"location {location}" if location not in _LOCATIONS else ""


def _linked(vertices: list[Vertex]) -> set[int]:
    """Return the lanelets of which another one begins at the end, or ends at the beginning."""
    starts = np.array([[*v.left[0], *v.right[0]] for v in vertices])
    linked: set[int] = set()
    for v in vertices:
        end = (*v.left[-1], *v.right[-1])
        behind = {
            vertices[j].lanelet_id for j in np.flatnonzero(np.abs(starts - end).max(axis=1) < SAME_END_M)
        }
        if behind := behind - {v.lanelet_id}:
            linked |= {v.lanelet_id, *behind}
    return linked


def missing_lanelets(vertices: Sequence[Vertex], rules: Rules, map_file: MapFile) -> dict[int, Relation]:
    """Return the lanelets to add, by new id.

    One is missing where a lanelet begins at the right end of one lanelet and the left end of another, nothing
    leads into it, and the facing bounds have no lanelet between them and the distance of those of a lane.
    """
    drives = [v for v in vertices if rules.canPass(v.lanelet) and v.lane_id == v.lanelet_id]
    ends = {(tuple(v.left[-1]), tuple(v.right[-1])) for v in drives}
    on_left, on_right = ({tuple(getattr(v, side)[-1]): v for v in drives} for side in ("right", "left"))
    refs = {
        side: {r for i in map_file.of_type("lanelet").values() for r in i.refs(side, "way")}
        for side in ("left", "right")
    }
    added: dict[int, Relation] = {}
    ids = free_ids((*map_file.relations, *map_file.ways, *map_file.nodes))
    for lane in drives:
        begin = tuple(lane.left[0]), tuple(lane.right[0])
        left_lane, right_lane = on_left.get(begin[0]), on_right.get(begin[1])
        if begin in ends or left_lane is None or right_lane is None or left_lane is right_lane:
            continue
        before = map_file.relations[left_lane.lanelet_id]
        left = before.refs("right", "way")[0]
        right = map_file.relations[right_lane.lanelet_id].refs("left", "way")[0]
        widths_m = np.hypot(*(left_lane.right[[0, -1]] - right_lane.left[[0, -1]]).T)
        narrow_or_wide = widths_m.min() < MIN_ROAD_M or widths_m.max() > MAX_LANE_M
        if left in refs["left"] or right in refs["right"] or narrow_or_wide:
            continue
        sides = ((left, "left"), (right, "right"))
        bounds = tuple(Member(kind="way", ref=ref, role=side) for ref, side in sides)
        added[next(ids)] = Relation(members=bounds, tags=before.tags)
    return added
