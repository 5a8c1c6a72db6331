"""Topology figures of a net: successors, routes, lane changes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray
from scex_sumo.judge.conflicts import NEAR_M, near_runs
from scex_sumo.judge.matching import Matching, Stretch
from scex_sumo.road import Lane

JOIN_M = 0.1  # stretches of one SUMO lane that overlap by less follow one another
BESIDE_M = 1.0  # neighbours that share less than this (and than half of the shorter) only touch at a corner

Pair = tuple[int, int]
Node = TypeVar("Node", bound=Hashable)
# Moves are between stretches, so that a SUMO lane across several lanelets keeps their order.
Stretches = Mapping[str, tuple[Stretch, ...]]
Moves = Mapping[Stretch, set[Stretch]]
Changes = Mapping[tuple[Stretch, Stretch], float]


def judge_topology(matching: Matching) -> dict[str, Any]:
    """Compare the net's moves with the map's routing graph; pairs are lanelet ids.

    Loose edge routes are forbidden, but a router on edges would take them. Lane changes that only an edge
    within an intersection could hold, and routes over them, do not count as missing.
    """
    lanes = matching.road.vehicle_lanes
    vehicle = lanes.keys()
    on_lanes = {
        name: tuple(s for s in matching.by_sumo_lane.get(name, ()) if s.lane_id in vehicle)
        for name in matching.net.car_lanes
    }
    forward, changes = _forward(matching, on_lanes), _changes(matching, on_lanes)
    wanted = {(i, j) for i, lane in lanes.items() for j in lane.successors if j in lanes and j != i}
    joined = {(s.lane_id, t.lane_id) for s, ahead in forward.items() for t in ahead if s.lane_id != t.lane_id}
    permitted = {(i, j) for i, lane in lanes.items() for j in (lane.left, lane.right) if j in vehicle}
    adjacent = {
        (i, j) for i, lane in lanes.items() for j in (lane.adjacent_left, lane.adjacent_right) if j in vehicle
    }
    possible = _lengths_by_pair(changes, 0.0)
    inside = changes_inside(lanes) - set(possible)
    in_map, in_net = _routes_in_map(lanes, set()), _routes_in_net(forward, changes)
    missing = (_routes_in_map(lanes, inside) if inside else in_map) - in_net
    starts = {i for i, lane in lanes.items() if not vehicle & set(lane.predecessors)}
    ends = {i for i, lane in lanes.items() if not vehicle & set(lane.successors)}
    border = {(i, j) for i in starts for j in ends if i != j}
    pairs: dict[str, Any] = {
        "successors": len(wanted),
        "missing_successors": wanted - joined,
        "invented_successors": joined - wanted,
        "routes": len(in_map),
        "missing_routes": missing,
        "invented_routes": in_net - in_map,
        "border_routes": len(border & in_map),
        "missing_border_routes": border & missing,
        "invented_border_routes": border & (in_net - in_map),
        "loose_edge_routes": _edge_routes(matching, on_lanes, border) - in_map,
        "lane_changes": len(permitted),
        "missing_lane_changes": permitted - set(possible) - inside,
        "lane_changes_inside": inside,
        "lane_change_length_share": _length_share(lanes, permitted, possible),
        "forbidden_lane_changes": len(adjacent - permitted),
        "invented_lane_changes": set(_lengths_by_pair(changes, BESIDE_M)) - permitted,
    }
    return {name: tuple(sorted(value)) if isinstance(value, set) else value for name, value in pairs.items()}


def _forward(matching: Matching, on_lanes: Stretches) -> dict[Stretch, set[Stretch]]:
    following = matching.net.following
    empty = {name: {*following.get(name, ())} for name, on in on_lanes.items() if not on}
    moves: dict[Stretch, set[Stretch]] = {}
    for name, on in on_lanes.items():
        for stretch in on:
            moves[stretch] = _first(other for other in on if _precedes(stretch, other))
            if not moves[stretch]:
                entered = _reached(following.get(name, ()), empty)
                moves[stretch] = {s for lane in entered for s in _first(on_lanes[lane])}
    return moves


def _first(stretches: Iterable[Stretch]) -> set[Stretch]:
    among = list(stretches)
    return {s for s in among if not any(_precedes(other, s) for other in among)}


def _precedes(one: Stretch, other: Stretch) -> bool:
    return other.start_m >= one.end_m - JOIN_M and not one.start_m >= other.end_m - JOIN_M


def _changes(matching: Matching, on_lanes: Stretches) -> dict[tuple[Stretch, Stretch], float]:
    found: dict[tuple[Stretch, Stretch], float] = {}
    lanes = matching.net.lanes
    for names in matching.net.edges.values():
        for right, left in pairwise(names):
            lengths = [max(lanes[name].line.length, 1e-9) for name in (right, left)]
            for one in on_lanes.get(right, ()):
                for other in on_lanes.get(left, ()):
                    start = max(one.start_m / lengths[0], other.start_m / lengths[1])
                    end = min(one.end_m / lengths[0], other.end_m / lengths[1])
                    shared = float((end - start) * min(lengths))
                    if shared > 0.0 and lanes[right].change_left:
                        found[one, other] = shared
                    if shared > 0.0 and lanes[left].change_right:
                        found[other, one] = shared
    return found


def _beside(one: Stretch, other: Stretch, shared: float, least_m: float) -> bool:
    return shared >= min(least_m, 0.5 * min(one.end_m - one.start_m, other.end_m - other.start_m))


def _lengths_by_pair(changes: Changes, least_m: float) -> dict[Pair, float]:
    lengths: dict[Pair, float] = defaultdict(float)
    for (one, other), shared in changes.items():
        if one.lane_id != other.lane_id and _beside(one, other, shared, least_m):
            lengths[one.lane_id, other.lane_id] += shared
    return dict(lengths)


def _length_share(lanes: Mapping[int, Lane], permitted: set[Any], possible: Mapping[Pair, float]) -> float:
    lengths = {pair: shapely.LineString(lanes[pair[0]].centreline).length for pair in permitted}
    allowed = sum(min(possible.get(pair, 0.0), length) for pair, length in lengths.items())
    return allowed / sum(lengths.values()) if lengths else 1.0


def _routes_in_map(lanes: Mapping[int, Lane], without: Collection[Pair]) -> set[Pair]:
    ahead = {
        i: lanes.keys() & {*lane.successors, *(j for j in (lane.left, lane.right) if (i, j) not in without)}
        for i, lane in lanes.items()
    }
    return {(i, j) for i in lanes for j in _reached([i], ahead) if j != i}


def _routes_in_net(forward: Moves, changes: Changes) -> set[Pair]:
    ahead = {s: set(targets) for s, targets in forward.items()}
    for (one, other), shared in changes.items():
        if _beside(one, other, shared, BESIDE_M):  # corners would invent routes around junctions
            ahead[one].add(other)
    own: dict[int, list[Stretch]] = defaultdict(list)
    for stretch in ahead:
        own[stretch.lane_id].append(stretch)
    return {(i, s.lane_id) for i, sources in own.items() for s in _reached(sources, ahead) if s.lane_id != i}


def _edge_routes(matching: Matching, on_lanes: Stretches, border: Collection[Pair]) -> set[Pair]:
    lanes = matching.net.lanes
    ahead: dict[str, set[str]] = defaultdict(set)
    for link in matching.net.car_links:
        ahead[lanes[link.from_lane].edge_id].add(lanes[link.to_lane].edge_id)
    edges: dict[int, set[str]] = defaultdict(set)
    for name, on in on_lanes.items():
        for stretch in () if lanes[name].internal else on:
            edges[stretch.lane_id].add(lanes[name].edge_id)
    reached = {i: _reached(edges[i], ahead) for i in {pair[0] for pair in border}}
    return {(i, j) for i, j in border if reached[i] & edges[j] and not edges[i] & edges[j]}


def _reached(sources: Iterable[Node], ahead: Mapping[Node, set[Node]]) -> set[Node]:
    seen = set(sources)
    stack = list(seen)
    while stack:
        for node in ahead.get(stack.pop(), ()):
            if node not in seen:
                seen.add(node)
                stack.append(node)
    return seen


ROOM_M = 7.5  # a car and its gap: SUMO changes lanes on edges only
FRACTIONS = 201  # samples along lanes side by side


def changes_inside(lanes: Mapping[int, Lane]) -> set[tuple[int, int]]:
    """Permitted changes between lanelets of which no stretch as long as a car is clear of other lanelets."""
    found: set[tuple[int, int]] = set()
    for group in _groups(lanes):
        free = np.logical_and.reduce([_free(lanes, i, group) for i in group])
        longest = max((end - start + 1 for start, end in near_runs(free)), default=0)
        length = float(np.mean([shapely.LineString(lanes[i].centreline).length for i in group]))
        if longest / FRACTIONS * length < ROOM_M:
            found |= {(i, j) for i in group for j in (lanes[i].left, lanes[i].right) if j in group}
    return found


def _groups(lanes: Mapping[int, Lane]) -> list[set[int]]:
    groups: list[set[int]] = []
    for i, lane in lanes.items():
        own = {i} | {j for j in (lane.left, lane.right) if j is not None and j in lanes}
        if len(own) > 1:
            joined = [group for group in groups if group & own]
            groups = [group for group in groups if not group & own] + [own.union(*joined)]
    return groups


def _free(lanes: Mapping[int, Lane], lane_id: int, group: set[int]) -> BoolArray:
    line = shapely.LineString(lanes[lane_id].centreline)
    points = shapely.line_interpolate_point(line, np.linspace(0.0, 1.0, FRACTIONS), normalized=True)
    others = [i for i in lanes[lane_id].conflicts if i in lanes and i not in group]
    if not others:
        return np.ones(FRACTIONS, dtype=np.bool_)
    lines = shapely.MultiLineString([lanes[i].centreline for i in others])
    return np.asarray(shapely.distance(points, lines) > NEAR_M)
