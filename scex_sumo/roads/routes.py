"""Routes of vehicles: where they can go over lanes, and the centrelines under them.

Nothing here depends on a behaviour model: a route is a sequence of lane ids, a candidate path a route with
the centreline under it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import (
    along,
    arc_lengths,
    blend_over,
    headings,
    join_owned,
    nearest,
    wrap,
)
from scex_sumo.road import Lane, Road
from scex_sumo.roads.matching import OFFSET_SIGMA_M, Matches, match, off_road
from scex_sumo.scene import SeedScene

__all__ = [
    "CandidatePath",
    "Matches",
    "candidate_paths",
    "centreline",
    "extended",
    "match",
    "off_road",
    "onward",
    "routes",
]

CHANGE_LENGTH_M = 40.0  # lane change at the end of a lane
MAX_ROUTES = 32
HORIZON_M, HORIZON_S = 80.0, 6.0  # of a candidate path


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidatePath:
    """One way a vehicle can go.

    Attributes:
        lanes: lane ids; the vehicle is on the first. Two that follow each other are successors, or
            neighbours where a lane ends and a lane change is the only way on.
        s: arc length of the vehicle's foot point on the first lane, m.
        probability: of this path among the vehicle's: match probability, shared equally at every fork.
        angle: direction from the vehicle to the end of the path in the vehicle's frame, rad, left positive.
    """

    lanes: tuple[int, ...]
    s: float
    probability: float
    angle: float


def routes(road: Road, lane_id: int, s: float, horizon_m: float) -> tuple[tuple[int, ...], ...]:
    """All lane sequences from a place on the road over a distance.

    Follows successors; where a lane has none but a lane change is allowed, it goes on on the neighbour
    (left first). Ends at the horizon or at the end of the mapped road; in a roundabout a lane can come twice.

    Args:
        road: the map.
        lane_id: lane to start on.
        s: arc length on that lane, m.
        horizon_m: distance to cover, m.

    Returns:
        At most `MAX_ROUTES` routes in the order of a depth-first search over ascending lane ids.
    """
    lanes, length = _known(road), _lengths(road)
    found: list[tuple[int, ...]] = []
    stack: list[tuple[tuple[int, ...], float]] = [((lane_id,), length[lane_id] - s)]
    while stack and len(found) < MAX_ROUTES:
        route, covered = stack.pop()
        following, gain = onward(lanes, route)
        if covered >= horizon_m or not following:
            found.append(route)
            continue
        for lane in reversed(following):
            stack.append(((*route, lane), covered + (length[lane] if gain else 0.0)))
    return tuple(found)


def onward(lanes: dict[int, Lane], route: tuple[int, ...]) -> tuple[list[int], bool]:
    """Lanes that can follow a route, and whether they lie ahead (False: beside, by a lane change)."""
    last = lanes[route[-1]]
    ahead = sorted(i for i in last.successors if i in lanes)
    if ahead:
        return ahead, True
    beside = [i for i in (last.left, last.right) if i is not None and i in lanes and i not in route]
    # A neighbour that ends as well leads nowhere; one change after the other is not tried.
    return [i for i in beside if lanes[i].successors][:1], False


@derived
def _known(road: Road) -> dict[int, Lane]:
    return road.vehicle_lanes


@derived
def _lengths(road: Road) -> dict[int, float]:
    """Lengths of the vehicle lanes, m; never zero, so that every search along them ends."""
    steps = {i: np.diff(lane.centreline, axis=0) for i, lane in _known(road).items()}
    return {i: max(float(np.hypot(*step.T).sum()), 0.01) for i, step in steps.items()}


@derived
def _turns(road: Road) -> dict[tuple[int, int], float]:
    return {}


def _turn(road: Road, lane: int, other: int) -> float:
    """Change of direction from the end of a lane to 10 m down the other, rad, without its sign."""
    turns = _turns(road)  # filled as turns are asked for; forgotten with the road
    if (lane, other) not in turns:
        line = road.lanes[other].centreline
        there = along(line, np.array([0.0, min(10.0, _lengths(road)[other])]))
        towards = np.arctan2(*(there[1] - there[0])[::-1])
        turns[lane, other] = abs(float(wrap(towards - headings(road.lanes[lane].centreline)[-1])))
    return turns[lane, other]


def candidate_paths(road: Road, scene: SeedScene) -> tuple[tuple[CandidatePath, ...], ...]:
    """Paths that each vehicle of a seed scene can take, from its pose at that moment.

    A path is 80 m long, or 6 s at the vehicle's speed where that is longer. Paths are ordered from left to
    right: by falling angle from the vehicle to the path's end, then by lane ids.

    Args:
        road: the map.
        scene: the seed scene.

    Returns:
        (V,) paths of each vehicle; none for a vehicle off the mapped lanes.
    """
    now = scene.now
    found = match(road, now.x, now.y, now.heading)
    result: list[tuple[CandidatePath, ...]] = []
    for v in range(scene.vehicles):
        mine = np.flatnonzero(found.vehicle == v)
        pose = (float(now.x[v]), float(now.y[v]), float(now.heading[v]))
        horizon = max(HORIZON_M, HORIZON_S * float(now.speed[v]))
        starts = _starts(road, found, mine, _past(scene, v))
        total = sum(p for _, _, p in starts)
        paths = [
            path for lane, s, p in starts for path in _paths_from(road, lane, s, p / total, horizon, pose)
        ]
        result.append(tuple(sorted(paths, key=lambda path: (-round(path.angle, 9), path.lanes))))
    return tuple(result)


def _past(scene: SeedScene, vehicle: int) -> FloatArray:
    """(P, 2) where the vehicle was half a second and a second before, as far as that was recorded."""
    back = [steps for steps in (5, 10) if scene.recorded_steps[vehicle] >= steps]
    track = scene.history[vehicle]
    return np.array([[track.x[-1 - steps], track.y[-1 - steps]] for steps in back]).reshape(-1, 2)


def _starts(road: Road, found: Matches, mine: IntArray, past: FloatArray) -> list[tuple[int, float, float]]:
    """(lane, s, probability) of the lanes a vehicle's routes start on, best first.

    Where several lanes match, those count more that the vehicle has come along: each gets the likelihood of
    the distance of the past places to it and its predecessors too, at most two sigma each. The best one is
    taken, and others at least 0.3 times as probable, unless they are ahead of or behind a lane taken
    already: their routes are the same ones cut differently.
    """
    options = [(int(found.lane_id[i]), float(found.s[i]), float(found.probability[i])) for i in mine]
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
    """Likelihood that a vehicle on a lane was at these places before."""
    points, _ = centreline(road, (lane,), s, 60.0, 5.0)
    cost = 0.0
    for x, y in past:
        (foot,) = along(points, np.array([nearest(points, float(x), float(y))]))
        distance = float(np.hypot(foot[0] - x, foot[1] - y))
        cost += min(distance / OFFSET_SIGMA_M, 2.0) ** 2
    return float(np.exp(-0.5 * cost))


def _paths_from(
    road: Road, lane: int, s: float, probability: float, horizon: float, pose: tuple[float, float, float]
) -> list[CandidatePath]:
    ways = routes(road, lane, s, horizon)
    x, y, heading = pose
    paths = []
    for way in ways:
        share = probability
        for i in range(1, len(way)):  # alternatives at each fork, counted among the routes found
            share /= len({other[i] for other in ways if other[:i] == way[:i] and len(other) > i})
        points, _ = centreline(road, way, s, 0.0, horizon)
        dx, dy = points[-1] - (x, y)
        angle = float(wrap(np.arctan2(dy, dx) - heading))
        paths.append(CandidatePath(lanes=way, s=s, probability=share, angle=angle))
    return paths


def extended(road: Road, lanes: tuple[int, ...], length_m: float) -> tuple[int, ...]:
    """A route continued, by the smallest turn at every fork, to a length or to the end of the road."""
    known, length = _known(road), _lengths(road)
    # A lane beside the one before adds nothing: the change is made within its length.
    covered = length[lanes[0]] + sum(length[b] for a, b in pairwise(lanes) if b in known[a].successors)
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
    """Centreline of a route around a place on its first lane, straight on at both ends of the road.

    Before the first lane it follows the predecessors with the smallest turn.

    Args:
        road: the map.
        lanes: the route.
        s: the place, arc length on the first lane, m.
        behind_m: length before the place, m.
        ahead_m: length after the place, m.

    Returns:
        (P, 2) points, exactly `behind_m` before the place to `ahead_m` after it along the line, and (P,)
        the lane id under each.
    """
    known, length = _known(road), _lengths(road)
    before: list[int] = []
    missing = behind_m - s
    while missing > 0:
        at = before[0] if before else lanes[0]
        options = [i for i in known[at].predecessors if i in known]
        if not options:
            break
        before.insert(0, min((_turn(road, i, at), i) for i in options)[1])
        missing -= length[before[0]]
    sequence = (*before, *extended(road, lanes, s + ahead_m))
    pieces, owners = _pieces(known, sequence)
    points, owner = join_owned(pieces, owners)
    start = sum(length[i] for i in before) + s - behind_m
    return _cut(points, owner, start, behind_m + ahead_m)


def _pieces(known: dict[int, Lane], sequence: tuple[int, ...]) -> tuple[list[FloatArray], list[int]]:
    """Centrelines of a sequence of lanes; a change to a neighbour is blended over the end of the lane."""
    pieces: list[FloatArray] = []
    rest = known[sequence[0]].centreline
    for a, b in pairwise(sequence):
        if b in known[a].successors:
            pieces.append(rest)
            rest = known[b].centreline
        else:
            piece, rest = blend_over(rest, known[b].centreline, CHANGE_LENGTH_M)
            pieces.append(piece)
    return [*pieces, rest], list(sequence)


def _cut(points: FloatArray, owner: IntArray, start: float, length: float) -> tuple[FloatArray, IntArray]:
    """The part of a line from an arc length on, continued straight where the line is too short."""
    arc = arc_lengths(points)
    ends = np.array([start, start + length])
    inside = slice(int(np.searchsorted(arc, ends[0], side="right")), int(np.searchsorted(arc, ends[1])))
    at = np.clip(np.searchsorted(arc, ends, side="right") - 1, 0, len(points) - 1)
    edge = np.column_stack([np.interp(ends, arc, points[:, 0]), np.interp(ends, arc, points[:, 1])])
    # Straight on past the ends, along the first and the last step.
    first, last = points[1] - points[0], points[-1] - points[-2]
    edge[0] += min(start, 0.0) * first / np.hypot(*first)
    edge[1] += max(start + length - arc[-1], 0.0) * last / np.hypot(*last)
    cut = np.vstack([edge[:1], points[inside], edge[1:]])
    return cut, np.concatenate([owner[at[:1]], owner[inside], owner[at[1:]]])
