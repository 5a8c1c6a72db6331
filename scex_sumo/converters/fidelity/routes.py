"""Routes through a net, from border to border, that cars can be put on without standing in others' way."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.fidelity.matching import angle_between
from scex_sumo.converters.fidelity.net import JudgedLane, JudgedNet
from scex_sumo.geometry.polylines import cut, heading, length_of

LENGTH_M = 4.7  # of a car
WIDTH_M = 1.8
CHANGE_M = 10.0  # on a shorter edge two cars that want each other's lanes do not get past one another
HEAD_ON_RAD = np.deg2rad(150.0)


def border_routes(net: JudgedNet) -> list[tuple[str, ...]]:
    """Shortest route in edges for every pair of border edges that lanes lead between.

    Cars change lanes where the net permits and, unless there is no route then, leaves room; a net without
    borders starts and ends anywhere. No route begins where a car would stand in the way of others.
    """
    edges = {lane.edge_id for lane in net.car_lanes.values() if not lane.internal}
    entered = {net.lanes[link.to_lane].edge_id for link in net.car_links}
    left = {net.lanes[link.from_lane].edge_id for link in net.car_links}
    first = edges - entered
    starts, ends = first - _in_the_way(net, first) or first or edges, edges - left or edges
    alone = edges - entered - left
    for room_m in (CHANGE_M, 0.0):
        moves = _lane_moves(net, room_m)
        routes = [
            path
            for start in sorted(starts)
            for end, path in sorted(_paths(net, moves, start).items())
            if end in ends and (end != start or start in alone)
        ]
        if routes:
            break
    return routes


def _in_the_way(net: JudgedNet, starts: set[str]) -> set[str]:
    """Edges among some where a car that starts stands in others' way.

    Of two that are only in each other's, cars start on the longer one; whoever comes head-on is not looked
    at.
    """
    cars = {name: lane for name, lane in net.car_lanes.items() if length_of(lane.shape) > 0.0}
    apart = {name: set(net.edges[lane.edge_id]) for name, lane in cars.items() if lane.edge_id in starts}
    for link in net.car_links:
        if link.from_lane in apart:
            apart[link.from_lane] |= {*link.via, link.to_lane}
    order = sorted(apart, key=lambda name: (-cars[name].length_m, name))
    source = {via: link.from_lane for link in net.car_links if link.from_lane in apart for via in link.via}
    beside: dict[str, set[str]] = {name: set() for name in order}
    for name, other in _too_near(cars, {i: _standing(cars[i].shape) for i in order}, apart):
        passing = source.get(other, other)
        beside[name].add(passing)
        if passing in beside:
            beside[passing].add(name)
    allowed: set[str] = set()
    for name in order:
        if not beside[name] - (apart.keys() - allowed):
            allowed.add(name)
    return {cars[name].edge_id for name in apart.keys() - allowed}


def _too_near(
    cars: Mapping[str, JudgedLane], standing: Mapping[str, FloatArray], apart: Mapping[str, Iterable[str]]
) -> Iterator[tuple[str, str]]:
    """Lanes with a standing car, each with the lanes of others that pass too near to it."""
    names, order = list(cars), list(standing)
    driven = [
        np.vstack([*([standing[i][:1]] if i in standing else []), lane.shape]) for i, lane in cars.items()
    ]
    tree = shapely.STRtree([shapely.LineString(line) for line in driven])
    stands = [shapely.LineString(line) for line in standing.values()]
    for k, j in tree.query(stands, predicate="dwithin", distance=WIDTH_M).T.tolist():
        name, other = order[k], names[j]
        if other not in apart[name] and not _head_on(standing[name], cars[other].shape):
            yield name, other


def _standing(line: FloatArray) -> FloatArray:
    """Where a car's middle line lies that starts on a lane, from its rear, which may be before the lane."""
    length = length_of(line)
    if length >= LENGTH_M:
        return cut(line, 0.0, LENGTH_M)
    angle = heading(line, end=False)
    back = LENGTH_M * np.array([np.cos(angle), np.sin(angle)])
    return np.vstack([line[0] - back, line])


def _head_on(standing: FloatArray, line: FloatArray) -> bool:
    """Whether a lane runs against a standing car, where it is nearest."""
    at, to = shapely.LineString(line), shapely.LineString(standing)
    s = at.project(shapely.shortest_line(at, to).interpolate(0.0))
    near = cut(line, max(s - 1.0, 0.0), min(s + 1.0, length_of(line)))
    ways = (heading(near, end=True), heading(standing, end=True))
    return bool(abs(angle_between(*map(np.float64, ways))) > HEAD_ON_RAD)


def _lane_moves(net: JudgedNet, room_m: float) -> dict[str, list[str]]:
    moves: dict[str, list[str]] = defaultdict(list)
    for link in net.car_links:
        moves[link.from_lane].append(link.to_lane)
    for names in net.edges.values():
        for right, left in pairwise(net.lanes[name] for name in names):
            if right.cars and left.cars and not right.internal and right.length_m >= room_m:
                moves[right.lane_id] += [left.lane_id] if right.change_left else []
                moves[left.lane_id] += [right.lane_id] if left.change_right else []
    return moves


def _paths(net: JudgedNet, moves: dict[str, list[str]], start: str) -> dict[str, tuple[str, ...]]:
    """Edges passed from a start edge to every edge in reach, fewest moves first."""
    queue = [name for name in net.edges[start] if net.lanes[name].cars]
    passed: dict[str, tuple[str, ...]] = {name: (start,) for name in queue}
    paths: dict[str, tuple[str, ...]] = {start: (start,)}
    for name in queue:
        for ahead in moves.get(name, ()):
            edge = net.lanes[ahead].edge_id
            if ahead not in passed:
                passed[ahead] = passed[name] if edge == passed[name][-1] else (*passed[name], edge)
                paths.setdefault(edge, passed[ahead])
                queue.append(ahead)
    return paths
