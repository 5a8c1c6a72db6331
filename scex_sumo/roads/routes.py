"""Routes of vehicles: sequences of lanes that they can take, and their centrelines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import along, arc_lengths, headings, length_of, project, wrap
from scex_sumo.road import Lane, Road
from scex_sumo.roads.matching import OFFSET_SIGMA_M, Matches, match
from scex_sumo.scene import SeedScene

MAX_ROUTES = 32
HORIZON_M, HORIZON_S = 80.0, 6.0  # of a candidate path for futures of 3 s: they, and a plan of 3 s
PLAN_S = 3.0
Pose: TypeAlias = tuple[float, float, float]
MAX_LONGER = 12  # paths of a vehicle from one lane, with the forks that only longer futures reach


@dataclass(frozen=True, eq=False)
class CandidatePath:
    """One way a vehicle can go."""

    # ids from the vehicle's on; a next one is a successor, or a neighbour if that is the only way on
    lanes: tuple[int, ...]
    s: float  # arc length of the vehicle's foot point on the first lane, m
    probability: float  # of the match, shared equally at every fork
    # from the vehicle to the end in its frame, rad, left positive; without forks of longer futures alone
    angle: float
    end_angle: float = 0.0  # with these forks
    straight_on: bool = True  # whether it takes the smallest turn at each of them
    intended: bool = False  # whether it is the route that SUMO's simulation has for the vehicle


OFF_ROAD = CandidatePath(lanes=(), s=0.0, probability=1.0, angle=0.0)
"""Straight on, of a vehicle beside the lanes."""


def routes(road: Road, lane_id: int, s: float, horizon_m: float) -> tuple[tuple[int, ...], ...]:
    """Return the lane sequences from arc length ``s`` on a lane over a distance, at most `MAX_ROUTES`.

    A route follows successors, else changes to a neighbour if allowed, left first. It ends at the horizon, at
    the end of the road, or at a fork that would make too many; nearer forks come first. The order is that of
    the lane ids.
    """
    return _with_forks(road, ((lane_id,),), s, horizon_m, MAX_ROUTES)


def onward(lanes: dict[int, Lane], route: tuple[int, ...]) -> tuple[list[int], bool]:
    """Return the lanes that can follow a route, and whether they lie ahead or need a lane change."""
    last = lanes[route[-1]]
    ahead = sorted(i for i in last.successors if i in lanes)
    if ahead:
        return ahead, True
    beside = [i for i in (last.left, last.right) if i is not None and i in lanes and i not in route]
    # Two changes in a row are not tried.
    return [i for i in beside if lanes[i].successors][:1], False


@owner_cache
def _lengths(road: Road) -> dict[int, float]:
    steps = {i: np.diff(lane.centreline, axis=0) for i, lane in road.vehicle_lanes.items()}
    return {i: max(float(np.hypot(*step.T).sum()), 0.01) for i, step in steps.items()}


@owner_cache
def _turn(road: Road, lane: int, other: int) -> float:
    there = along(road.lanes[other].centreline, np.array([0.0, min(10.0, _lengths(road)[other])]))
    towards = np.arctan2(*(there[1] - there[0])[::-1])
    return abs(float(wrap(towards - headings(road.lanes[lane].centreline)[-1])))


def candidate_paths(road: Road, scene: SeedScene) -> tuple[tuple[CandidatePath, ...], ...]:
    """Return the paths that each vehicle of a seed scene can take, from left to right; none off the lanes.

    A path is 80 m long, or 6 s at the vehicle's speed if that is longer; in longer futures in proportion.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> paths = scex.candidate_paths(scene.road, scene)
        >>> len(paths) == scene.vehicles, abs(sum(path.probability for path in paths[0]) - 1) < 1e-9
        (True, True)
    """
    now, longer = scene.now, (scene.horizon_s + PLAN_S) / HORIZON_S
    matches = match(road, now.x, now.y, now.heading)
    result: list[tuple[CandidatePath, ...]] = []
    for v in range(scene.vehicles):
        mine = np.flatnonzero(matches.vehicle == v)
        pose = (float(now.x[v]), float(now.y[v]), float(now.heading[v]))
        first = max(HORIZON_M, HORIZON_S * float(now.speed[v]))
        horizon = longer * first
        back = [-1 - steps for steps in (5, 10) if scene.recorded_steps[v] >= steps]
        past = np.column_stack([scene.history.x[v, back], scene.history.y[v, back]])
        starts = _starts(road, matches, mine, past)
        total = sum(p for _, _, p in starts)
        paths = [
            path
            for lane, s, p in starts
            for path in _paths_from(road, lane, s, p / total, (first, horizon), pose)
        ]
        if (intention := scene.intention(v)) is not None:
            paths = _with_intended(road, paths, starts, intention.lanes, horizon, pose)
        paths.sort(key=lambda path: (-round(path.angle, 9), -round(path.end_angle, 9), path.lanes))
        result.append(tuple(paths))
    return tuple(result)


def _with_intended(
    road: Road,
    paths: list[CandidatePath],
    starts: list[tuple[int, float, float]],
    allowed: frozenset[int],
    horizon: float,
    pose: Pose,
) -> list[CandidatePath]:
    start = next(((lane, s) for lane, s, _ in starts if lane in allowed), None)
    if start is None:
        return paths
    from scex_sumo.roads.changes import with_few_changes

    lane, s = start
    route = with_few_changes(road.vehicle_lanes, _lengths(road), lane, s, allowed, horizon)
    for k, path in enumerate(paths):
        if path.lanes == route:
            paths[k] = replace(path, intended=True)
            return paths
    return [*paths, CandidatePath(route, s, 0.0, _angle(road, route, s, horizon, pose), intended=True)]


def _starts(road: Road, matches: Matches, mine: IntArray, past: FloatArray) -> list[tuple[int, float, float]]:
    """Return (lane, s, probability) of the lanes that a vehicle's routes start on, best first.

    If several lanes match, the past decides. Lanes under 0.3 times as probable as the best, ahead of or
    behind a taken one are left out.
    """
    options = [(int(matches.lane_id[i]), float(matches.s[i]), float(matches.probability[i])) for i in mine]
    if len(options) > 1 and len(past):
        options = [(lane, s, p * _came_along(road, lane, s, past)) for lane, s, p in options]
        options.sort(key=lambda option: (-option[2], option[0]))
    kept: list[tuple[int, float, float]] = []
    for lane, s, p in options:
        if kept and p < 0.3 * kept[0][2]:
            break
        linked = {*road.lanes[lane].successors, *road.lanes[lane].predecessors}
        if not any(other in linked for other, _, _ in kept):
            kept.append((lane, s, p))
    return kept


def _came_along(road: Road, lane: int, s: float, past: FloatArray) -> float:
    points, _ = centreline(road, (lane,), s, 60.0, 5.0)
    _, distance = project(past, points)
    return float(np.exp(-0.5 * (np.minimum(distance / OFFSET_SIGMA_M, 2.0) ** 2).sum()))


def _paths_from(
    road: Road, lane: int, s: float, probability: float, horizons: tuple[float, float], pose: Pose
) -> list[CandidatePath]:
    first, horizon = horizons
    options = straight = routes(road, lane, s, first)
    if horizon > first:
        straight = tuple(extended(road, route, s + horizon) for route in options)
        options = _with_forks(road, options, s, horizon, MAX_LONGER)
    paths = []
    for route in options:
        share = probability
        for i in range(1, len(route)):  # alternatives at each fork
            share /= len({other[i] for other in options if other[:i] == route[:i] and len(other) > i})
        angle = _angle(road, route, s, first, pose)
        end_angle = _angle(road, route, s, horizon, pose) if horizon > first else angle
        straight_on = any(ahead[: len(route)] == route for ahead in straight)
        paths.append(CandidatePath(route, s, share, angle, end_angle, straight_on))
    return paths


def _with_forks(
    road: Road, options: tuple[tuple[int, ...], ...], s: float, horizon: float, most: int
) -> tuple[tuple[int, ...], ...]:
    """Extend routes by all forks up to a distance, the nearest first, up to ``most`` routes in all."""
    lanes, complete = road.vehicle_lanes, list[tuple[int, ...]]()
    open_routes = [(_covered(road, route) - s, route) for route in options]
    heapify(open_routes)
    while open_routes:
        covered, route = heappop(open_routes)
        following, gain = onward(lanes, route)
        count = len(complete) + len(open_routes) + len(following)
        if covered >= horizon or not following or (len(following) > 1 and count > most):
            complete.append(route)
            continue
        for lane in following:
            heappush(open_routes, (covered + (_lengths(road)[lane] if gain else 0.0), (*route, lane)))
    return tuple(sorted(complete))


def _covered(road: Road, lanes: tuple[int, ...]) -> float:
    known, length = road.vehicle_lanes, _lengths(road)
    return length[lanes[0]] + sum(length[b] for a, b in pairwise(lanes) if b in known[a].successors)


def _angle(road: Road, route: tuple[int, ...], s: float, horizon: float, pose: Pose) -> float:
    x, y, heading = pose
    points, _ = centreline(road, route, s, 0.0, horizon)
    dx, dy = points[-1] - (x, y)
    return float(wrap(np.arctan2(dy, dx) - heading))


def extended(road: Road, lanes: tuple[int, ...], length_m: float) -> tuple[int, ...]:
    """Extend a route by the smallest turn at every fork, to a length or to the end of the road."""
    known, length = road.vehicle_lanes, _lengths(road)
    covered = _covered(road, lanes)
    while covered < length_m:
        following, gain = onward(known, lanes)
        if not following:
            break
        turns = [(_turn(road, lanes[-1], i) if gain else 0.0, i) for i in following]
        chosen = min(turns)[1]
        lanes = (*lanes, chosen)
        covered += length[chosen] if gain else 0.0
    return lanes


def centreline(
    road: Road, lanes: tuple[int, ...], s: float, behind_m: float, ahead_m: float
) -> tuple[FloatArray, IntArray]:
    """Return the centreline (P, 2) of a route, m, and (P,) the lane id under each point.

    From ``behind_m`` before to ``ahead_m`` after arc length ``s`` of its first lane, along the smallest
    turns, straight on at the ends of the road.
    """
    known, length = road.vehicle_lanes, _lengths(road)
    before: list[int] = []
    missing = behind_m - s
    while missing > 0:
        first = before[0] if before else lanes[0]
        options = [i for i in known[first].predecessors if i in known]
        if not options:
            break
        before.insert(0, min((_turn(road, i, first), i) for i in options)[1])
        missing -= length[before[0]]
    sequence = (*before, *extended(road, lanes, s + ahead_m))
    here = sum(length[i] for i in before) + s
    follow = all(after in known[lane].successors for lane, after in pairwise(sequence))
    line = _without_changes(road, sequence) if follow else _joined(known, sequence, here)
    return _cut(*line, here - behind_m, behind_m + ahead_m)


@owner_cache
def _without_changes(road: Road, sequence: tuple[int, ...]) -> tuple[FloatArray, IntArray]:
    """Return the line of `_joined` for lanes that follow each other, of which each scene cuts its own."""
    return _joined(road.vehicle_lanes, sequence, 0.0)


def _joined(known: dict[int, Lane], sequence: tuple[int, ...], start: float) -> tuple[FloatArray, IntArray]:
    """Return the centreline of lanes without repeated points, and the lane of each point.

    Changes of lane begin after arc length ``start``.
    """
    pieces: list[FloatArray] = []
    owners: list[int] = []
    rest, passed, i = known[sequence[0]].centreline, 0.0, 0
    while i + 1 < len(sequence):
        if sequence[i + 1] in known[sequence[i]].successors:
            piece, owner, i = rest, sequence[i], i + 1
            rest = known[sequence[i]].centreline
        else:
            from scex_sumo.roads.changes import change_lanes

            piece, rest, count = change_lanes(known, sequence[i + 1 :], rest, start - passed)
            owner, i = sequence[i], i + count
        passed += length_of(piece)
        pieces.append(piece)
        owners.append(owner)
    pieces.append(rest)
    points = np.vstack(pieces)
    lanes = np.repeat(np.array([*owners, sequence[-1]], dtype=np.int64), [len(piece) for piece in pieces])
    step = np.hypot(*np.diff(points, axis=0).T)
    keep = np.concatenate([step > 1e-6, [True]])
    return points[keep], lanes[keep]


def _cut(points: FloatArray, owner: IntArray, start: float, length: float) -> tuple[FloatArray, IntArray]:
    arc = arc_lengths(points)
    ends = np.array([start, start + length])
    inside = slice(int(np.searchsorted(arc, ends[0], side="right")), int(np.searchsorted(arc, ends[1])))
    segment = np.clip(np.searchsorted(arc, ends, side="right") - 1, 0, len(points) - 1)
    edge = along(points, ends)
    first, last = points[1] - points[0], points[-1] - points[-2]
    edge[0] += min(start, 0.0) * first / np.hypot(*first)
    edge[1] += max(start + length - arc[-1], 0.0) * last / np.hypot(*last)
    cut = np.vstack([edge[:1], points[inside], edge[1:]])
    return cut, np.concatenate([owner[segment[:1]], owner[inside], owner[segment[1:]]])
