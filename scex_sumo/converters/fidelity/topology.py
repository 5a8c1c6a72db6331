"""Whether a net leads where its map does: successors, routes, lane changes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import shapely

from scex_sumo.converters.fidelity.matching import Matching, Stretch
from scex_sumo.converters.fidelity.net import Net
from scex_sumo.road import Lane, Road

JOIN_M = 0.1  # stretches of one SUMO lane that overlap by less follow one another
BESIDE_M = 1.0  # neighbours that share less than this (and than half of the shorter) only touch at a corner

Pair = tuple[int, int]
Node = TypeVar("Node", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class TopologyFigures:
    """What of the map's routing graph the net has, and what it has beyond; pairs are lanelet ids.

    Attributes:
        successors: successor pairs of the map's vehicle lanelets.
        missing_successors: those that no connection realises.
        invented_successors: lanelets that SUMO joins and the map does not.
        routes: origin-destination pairs of lanelets routable in the map.
        missing_routes: those that SUMO cannot drive, changing lanes as permitted.
        invented_routes: pairs that SUMO can drive and the map forbids.
        border_routes: routable pairs from a lanelet without predecessor to one without successor.
        missing_border_routes: those that SUMO cannot drive.
        invented_border_routes: border pairs that SUMO can drive and the map forbids.
        loose_edge_routes: border pairs that the map forbids and a router that heeds edges only would take.
        lane_changes: permitted changes of the map, each direction by itself.
        missing_lane_changes: those that no two neighbouring lanes of an edge allow.
        lane_change_length_share: share of the permitted changes' length along which SUMO allows them.
        forbidden_lane_changes: changes that the map's adjacent lanelets forbid.
        invented_lane_changes: changes that SUMO allows and the map does not permit.
    """

    successors: int
    missing_successors: tuple[Pair, ...]
    invented_successors: tuple[Pair, ...]
    routes: int
    missing_routes: tuple[Pair, ...]
    invented_routes: tuple[Pair, ...]
    border_routes: int
    missing_border_routes: tuple[Pair, ...]
    invented_border_routes: tuple[Pair, ...]
    loose_edge_routes: tuple[Pair, ...]
    lane_changes: int
    missing_lane_changes: tuple[Pair, ...]
    lane_change_length_share: float
    forbidden_lane_changes: int
    invented_lane_changes: tuple[Pair, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneGraph:
    """The net as moves between stretches, so that a SUMO lane across several lanelets keeps their order."""

    net: Net
    road: Road
    matching: Matching

    @cached_property
    def stretches(self) -> dict[str, tuple[Stretch, ...]]:
        """Stretches of vehicle lanelets on each car lane, in driving order."""
        vehicle = self.road.vehicle_lanes
        lanes = ((name, self.matching.by_sumo_lane.get(name, ())) for name in self.net.car_lanes)
        return {name: tuple(s for s in on if s.lane_id in vehicle) for name, on in lanes}

    @cached_property
    def forward(self) -> dict[Stretch, set[Stretch]]:
        """Moves straight ahead, across connections too."""
        moves: dict[Stretch, set[Stretch]] = {}
        for name, on in self.stretches.items():
            for stretch in on:
                later = [other for other in on if _precedes(stretch, other)]
                nearest = {o for o in later if not any(_precedes(between, o) for between in later)}
                moves[stretch] = nearest or self._entered_after(name)
        return moves

    def _entered_after(self, name: str) -> set[Stretch]:
        """First stretches met after a lane's end; lanes that stand for nothing are driven through."""
        entered: set[Stretch] = set()
        seen: set[str] = set()
        ahead = list(self.net.following.get(name, ()))
        while ahead:
            lane = ahead.pop()
            if lane in seen:
                continue
            seen.add(lane)
            on = self.stretches[lane]
            entered |= {s for s in on if not any(_precedes(other, s) for other in on)}
            if not on:
                ahead += self.net.following.get(lane, ())
        return entered

    @cached_property
    def changes(self) -> dict[tuple[Stretch, Stretch], float]:
        """Possible changes between neighbouring lanes of an edge, with the length that both share in m."""
        found: dict[tuple[Stretch, Stretch], float] = {}
        for names in self.net.edges.values():
            for right, left in pairwise(names):
                if right not in self.stretches or left not in self.stretches:
                    continue
                for one in self.stretches[right]:
                    for other in self.stretches[left]:
                        shared = self._shared(one, other)
                        if shared > 0.0 and self.net.lanes[right].change_left:
                            found[one, other] = shared
                        if shared > 0.0 and self.net.lanes[left].change_right:
                            found[other, one] = shared
        return found

    def _shared(self, one: Stretch, other: Stretch) -> float:
        """Length in m over which two stretches of neighbouring lanes lie side by side."""
        lengths = [
            max(shapely.LineString(self.net.lanes[s.sumo_lane].shape).length, 1e-9) for s in (one, other)
        ]
        start = max(one.start_m / lengths[0], other.start_m / lengths[1])
        end = min(one.end_m / lengths[0], other.end_m / lengths[1])
        return float((end - start) * min(lengths))


def _precedes(one: Stretch, other: Stretch) -> bool:
    ahead = other.start_m >= one.end_m - JOIN_M
    return ahead and not one.start_m >= other.end_m - JOIN_M


def judge_topology(net: Net, road: Road, matching: Matching) -> TopologyFigures:
    """Compare the net's moves with the map's."""
    graph = LaneGraph(net=net, road=road, matching=matching)
    lanes = road.vehicle_lanes
    wanted = {(i, j) for i, lane in lanes.items() for j in lane.successors if j in lanes and j != i}
    joined = {
        (s.lane_id, t.lane_id) for s, ahead in graph.forward.items() for t in ahead if s.lane_id != t.lane_id
    }
    permitted = {
        (i, j) for i, lane in lanes.items() for j in (lane.left, lane.right) if j is not None and j in lanes
    }
    possible = _lengths_by_pair(graph, 0.0)
    in_map, in_net = _routes_in_map(lanes), _routes_in_net(graph)
    starts = {i for i, lane in lanes.items() if not any(j in lanes for j in lane.predecessors)}
    ends = {i for i, lane in lanes.items() if not any(j in lanes for j in lane.successors)}
    border = {(i, j) for i in starts for j in ends if i != j}
    return TopologyFigures(
        successors=len(wanted),
        missing_successors=_sorted(wanted - joined),
        invented_successors=_sorted(joined - wanted),
        routes=len(in_map),
        missing_routes=_sorted(in_map - in_net),
        invented_routes=_sorted(in_net - in_map),
        border_routes=len(border & in_map),
        missing_border_routes=_sorted(border & (in_map - in_net)),
        invented_border_routes=_sorted(border & (in_net - in_map)),
        loose_edge_routes=_sorted(_edge_routes(graph, border) - in_map),
        lane_changes=len(permitted),
        missing_lane_changes=_sorted(permitted - set(possible)),
        lane_change_length_share=_length_share(lanes, permitted, possible),
        forbidden_lane_changes=len(_forbidden(lanes) - permitted),
        invented_lane_changes=_sorted(set(_lengths_by_pair(graph, BESIDE_M)) - permitted),
    )


def _sorted(pairs: Collection[Pair]) -> tuple[Pair, ...]:
    return tuple(sorted(pairs))


def _lengths_by_pair(graph: LaneGraph, least_m: float) -> dict[Pair, float]:
    """Total length per pair of lanelets along which SUMO allows the change; shorter contacts are left out."""
    lengths: dict[Pair, float] = defaultdict(float)
    for (one, other), shared in graph.changes.items():
        shorter = min(one.end_m - one.start_m, other.end_m - other.start_m)
        if one.lane_id != other.lane_id and shared >= min(least_m, 0.5 * shorter):
            lengths[one.lane_id, other.lane_id] += shared
    return dict(lengths)


def _length_share(lanes: Mapping[int, Lane], permitted: set[Pair], possible: Mapping[Pair, float]) -> float:
    lengths = {pair: shapely.LineString(lanes[pair[0]].centreline).length for pair in permitted}
    allowed = sum(min(possible.get(pair, 0.0), length) for pair, length in lengths.items())
    return allowed / sum(lengths.values()) if lengths else 1.0


def _forbidden(lanes: Mapping[int, Lane]) -> set[Pair]:
    beside = ((i, j) for i, lane in lanes.items() for j in (lane.adjacent_left, lane.adjacent_right))
    return {(i, j) for i, j in beside if j is not None and j in lanes}


def _routes_in_map(lanes: Mapping[int, Lane]) -> set[Pair]:
    moves = {i: [*lane.successors, lane.left, lane.right] for i, lane in lanes.items()}
    ahead = {i: {j for j in targets if j is not None and j in lanes} for i, targets in moves.items()}
    return {(i, j) for i in lanes for j in _reached([i], ahead) if j != i}


def _routes_in_net(graph: LaneGraph) -> set[Pair]:
    ahead = {s: set(targets) for s, targets in graph.forward.items()}
    # Corner contacts are no place to change lanes, and would invent routes around junctions.
    for (one, other), shared in graph.changes.items():
        if shared >= min(BESIDE_M, 0.5 * min(one.end_m - one.start_m, other.end_m - other.start_m)):
            ahead[one].add(other)
    own: dict[int, list[Stretch]] = defaultdict(list)
    for stretch in ahead:
        own[stretch.lane_id].append(stretch)
    return {(i, s.lane_id) for i, sources in own.items() for s in _reached(sources, ahead) if s.lane_id != i}


def _edge_routes(graph: LaneGraph, border: Collection[Pair]) -> set[Pair]:
    """Pairs that a router finds which knows connections between edges but no lanes."""
    net = graph.net
    ahead: dict[str, set[str]] = defaultdict(set)
    for link in net.links:
        if net.lanes[link.from_lane].cars and net.lanes[link.to_lane].cars:
            ahead[net.lanes[link.from_lane].edge_id].add(net.lanes[link.to_lane].edge_id)
    edges: dict[int, set[str]] = defaultdict(set)
    for name, on in graph.stretches.items():
        if not net.lanes[name].internal:
            for stretch in on:
                edges[stretch.lane_id].add(net.lanes[name].edge_id)
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
