"""Moves of a net beside the map's routing graph: successors, routes, lane changes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from graphlib import TopologicalSorter
from itertools import pairwise, product
from typing import TypeAlias, TypeVar

import numpy as np
import shapely
from scipy.cluster.hierarchy import DisjointSet
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scex_sumo.base.arrays import BoolArray
from scex_sumo.converters.net.links import SumoLink
from scex_sumo.geometry.polylines import length_of
from scex_sumo.lanelet2sumo.judge.matching import Matching, Stretch
from scex_sumo.lanelet2sumo.judge.priority import NEAR_M, Pair
from scex_sumo.lanelet2sumo.reader import NetContent
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import runs

BESIDE_M = 1.0  # neighbours that share less than this (and than half of the shorter) only touch at a corner
ROOM_M = 7.5  # a car and its gap: SUMO changes lanes on edges only
FRACTIONS = 201  # samples along lanes side by side

Rows: TypeAlias = dict[int, int]  # pairs of lanelets: by the first, a bit for each second one
Changes: TypeAlias = dict[tuple[Stretch, Stretch], float]
Node = TypeVar("Node", bound=Hashable)


class Moves:
    """Pairs of lanelets between which the map, and the net, let cars move.

    Attributes:
        routes: of the map; ``missing`` and ``invented`` are those of the net. Routes over ``inside`` do not
            count as missing.
        loose: routes by edges from border to border, which the map forbids and a router on edges would take.
        permitted: lane changes; ``adjacent`` lanelets lie side by side. ``inside`` are changes that only an
            edge within an intersection could hold.
        possible: lengths in m of the net's lane changes.
    """

    def __init__(self, matching: Matching) -> None:
        self.lanes = lanes = matching.road.vehicle_lanes
        self._ids = sorted(lanes)
        bit = {i: 1 << k for k, i in enumerate(self._ids)}
        # Moves are between stretches, so that a SUMO lane across several lanelets keeps their order.
        on_lanes, ahead = matching.driven, matching.onward()
        changes = _changes(matching, on_lanes)
        self.successors = {(i, j) for i in lanes for j in lanes[i].successors if j in lanes and i != j}
        self.permitted = {(i, j) for i, x in lanes.items() for j in (x.left, x.right) if j in lanes}
        sides = {i: (lane.adjacent_left, lane.adjacent_right) for i, lane in lanes.items()}
        self.adjacent = {(i, j) for i, both in sides.items() for j in both if j in lanes}
        self.possible = _lengths_by_pair(changes, 0.0)
        self.inside = _changes_inside(lanes) - self.possible.keys()
        self.missing_changes = self.permitted - self.possible.keys() - self.inside
        self.invented_changes = _lengths_by_pair(changes, BESIDE_M).keys() - self.permitted
        for (one, other), shared in changes.items():
            if _beside(one, other, shared, BESIDE_M):  # corners would invent routes around junctions
                ahead[one].add(other)
        reach = _reach({s: bit[s.lane_id] for s in ahead}, ahead)
        driven = _united((s.lane_id, row) for s, row in reach.items())
        steps = self.successors | self.permitted
        whole = _reach(bit, _by_first(steps))
        wanted = _reach(bit, _by_first(steps - self.inside | self.successors)) if self.inside else whole
        self.routes = {i: row & ~bit[i] for i, row in whole.items()}
        self.missing = {i: row & ~driven.get(i, bit[i]) & ~bit[i] for i, row in wanted.items()}
        self.invented = {i: row & ~whole[i] for i, row in driven.items()}
        self._ends = sum(bit[i] for i, lane in lanes.items() if lanes.keys().isdisjoint(lane.successors))
        led, same = _by_edges(matching, on_lanes, bit)
        self.loose = self.border({i: row & ~same[i] & ~whole[i] for i, row in led.items()})

    def border(self, routes: Rows) -> Rows:
        """Select the routes from border to border."""
        starts = {i for i, x in self.lanes.items() if self.lanes.keys().isdisjoint(x.predecessors)}
        return {i: row & self._ends for i, row in routes.items() if i in starts}

    def pairs(self, routes: Rows) -> list[Pair]:
        """Return the pairs of lanelets."""
        bits = {i: bin(row)[:1:-1] for i, row in sorted(routes.items()) if row}
        return [(i, self._ids[k]) for i, row in bits.items() for k, one in enumerate(row) if one == "1"]

    def length_share(self) -> float:
        """Return the share of the permitted lane changes' length on which the net allows them."""
        lengths = {(i, j): length_of(self.lanes[i].centreline) for i, j in self.permitted}
        allowed = sum(min(self.possible.get(pair, 0.0), length) for pair, length in lengths.items())
        return allowed / sum(lengths.values()) if lengths else 1.0


def _changes(matching: Matching, on_lanes: Mapping[str, Sequence[Stretch]]) -> Changes:
    changes: Changes = {}
    lanes = matching.net.lanes
    for right, left in (pair for names in matching.net.edges.values() for pair in pairwise(names)):
        if lanes[right].internal:  # SUMO keeps its lane in a junction
            continue
        lengths = [max(lanes[name].line.length, 1e-9) for name in (right, left)]
        for one, other in product(on_lanes.get(right, ()), on_lanes.get(left, ())):
            start = max(one.start_m / lengths[0], other.start_m / lengths[1])
            end = min(one.end_m / lengths[0], other.end_m / lengths[1])
            shared = float((end - start) * min(lengths))
            if shared > 0.0 and lanes[right].change_left:
                changes[one, other] = shared
            if shared > 0.0 and lanes[left].change_right:
                changes[other, one] = shared
    return changes


def _beside(one: Stretch, other: Stretch, shared: float, least_m: float) -> bool:
    return shared >= min(least_m, 0.5 * min(one.end_m - one.start_m, other.end_m - other.start_m))


def _lengths_by_pair(changes: Changes, least_m: float) -> dict[Pair, float]:
    lengths: dict[Pair, float] = defaultdict(float)
    for (one, other), shared in changes.items():
        if one.lane_id != other.lane_id and _beside(one, other, shared, least_m):
            lengths[one.lane_id, other.lane_id] += shared
    return dict(lengths)


def _by_first(pairs: Iterable[tuple[Node, Node]]) -> dict[Node, set[Node]]:
    ahead: dict[Node, set[Node]] = defaultdict(set)
    for one, other in pairs:
        ahead[one].add(other)
    return ahead


def _united(rows: Iterable[tuple[int, int]]) -> Rows:
    united: Rows = defaultdict(int)
    for i, row in rows:
        united[i] |= row
    return united


def _reach(own: Mapping[Node, int], ahead: Mapping[Node, Iterable[Node]]) -> dict[Node, int]:
    """Return the bits of each node and of all nodes that it leads to."""
    if not own:
        return {}
    number = {node: k for k, node in enumerate(own)}
    steps = [(number[i], number[j]) for i, others in ahead.items() for j in others]
    rows, columns = np.array(steps, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(steps)), (rows, columns)), shape=(len(own), len(own)))
    ring: list[int] = connected_components(graph, connection="strong")[1].tolist()
    onward = _by_first((ring[i], ring[j]) for i, j in steps if ring[i] != ring[j])
    reach = _united(zip(ring, own.values(), strict=True))
    for k in TopologicalSorter({k: onward.get(k, set()) for k in reach}).static_order():
        for other in onward.get(k, ()):  # sorted before
            reach[k] |= reach[other]
    return {node: reach[k] for node, k in zip(own, ring, strict=True)}


def car_links(net: NetContent) -> list[SumoLink]:
    """Links between lanes for passenger cars."""
    return [k for k in net.links if k.from_lane in net.car_lanes and k.to_lane in net.car_lanes]


def _by_edges(
    matching: Matching, on_lanes: Mapping[str, Sequence[Stretch]], bit: Mapping[int, int]
) -> tuple[Rows, Rows]:
    """Return the lanelets that edges lead to from a lanelet, and those on its own edges."""
    lanes = matching.net.lanes
    on = [(lanes[n].edge_id, s.lane_id) for n, own in on_lanes.items() if not lanes[n].internal for s in own]
    links = [(lanes[link.from_lane].edge_id, lanes[link.to_lane].edge_id) for link in car_links(matching.net)]
    own = dict.fromkeys((lane.edge_id for lane in lanes.values()), 0)
    for name, i in on:
        own[name] |= bit[i]
    reach = _reach(own, _by_first(links))
    return _united((i, reach[name]) for name, i in on), _united((i, own[name]) for name, i in on)


def _changes_inside(lanes: Mapping[int, Lane]) -> set[Pair]:
    """Permitted changes between lanelets of which no stretch as long as a car is clear of other lanelets."""
    beside = [(i, j) for i, lane in lanes.items() for j in (lane.left, lane.right) if j in lanes]
    groups, inside = DisjointSet({i for pair in beside for i in pair}), set[int]()
    for pair in beside:
        groups.merge(*pair)
    for group in groups.subsets():
        free = np.logical_and.reduce([_free(lanes, i, group) for i in group])
        longest = max((end - start + 1 for start, end in runs(free)), default=0)
        if longest / FRACTIONS * np.mean([length_of(lanes[i].centreline) for i in group]) < ROOM_M:
            inside |= group
    return {(i, j) for i, j in beside if i in inside and j is not None}


def _free(lanes: Mapping[int, Lane], lane_id: int, group: Collection[int]) -> BoolArray:
    others = [lanes[i].centreline for i in lanes[lane_id].conflicts if i in lanes and i not in group]
    line = shapely.LineString(lanes[lane_id].centreline)
    points = shapely.line_interpolate_point(line, np.linspace(0.0, 1.0, FRACTIONS), normalized=True)
    return ~np.asarray(shapely.distance(points, shapely.MultiLineString(others)) <= NEAR_M)
