"""Relations of all pairs of a road's lanes: one behind the other, side by side, meeting ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import along, arc_lengths, length_of
from scex_sumo.road import Lane, Road
from scex_sumo.roads.conflicts import Conflict, conflicts, crossings_of, lines_cross, opposed

CONFLICT_M = 80.0  # sight of drivers
CONFLICTS = 4  # meeting places per pair of lanes
BESIDE_M = 30.0  # along the lanes
SIDEWAYS = 2
SAMPLE_M = 0.5  # of the search for closest places


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneRelations:
    """Tables over ordered pairs (a, b) of the L vehicle lanes; arc lengths from a lane's start."""

    lane_id: IntArray  # (L,) in the order of the tables; of `road_index` ascending
    speed_limit: FloatArray  # (L,) m/s
    length: FloatArray  # (L,) m
    # (L, L) way from the start of a to that of b along successors, m; else inf; 0 on the diagonal
    ahead: FloatArray
    loop: FloatArray  # (L,) shortest way from the start of a lane back to its start, m; else inf
    # (L, L) how many lanes b lies left (positive) of a, at most `BESIDE_M` before or after it; else 0
    side: IntArray
    # (L, L) where `side`: s_b on b leads s_a on a by lead + stretch_b·s_b - stretch_a·s_a, m
    lead: FloatArray
    stretch_a: FloatArray
    stretch_b: FloatArray
    # (L, L, CONFLICTS, 2) ways from the start of a, and of b, to where they meet, nearest first, m; else inf
    meeting: FloatArray


def lane_relations(lanes: Sequence[Lane]) -> LaneRelations:
    """Relate the L vehicle lanes of a road to each other; other lanes that they name are ignored."""
    number = {lane.lane_id: k for k, lane in enumerate(lanes)}
    length = np.array([length_of(lane.centreline) for lane in lanes], dtype=np.float64)
    ahead, loop = _ways(lanes, number, length)
    side, lead, stretch_a, stretch_b = _beside(lanes, number, length, ahead)
    return LaneRelations(
        lane_id=np.array([lane.lane_id for lane in lanes], dtype=np.int64),
        speed_limit=np.array([lane.speed_limit_mps for lane in lanes], dtype=np.float64),
        length=length,
        ahead=ahead,
        loop=loop,
        side=side,
        lead=lead,
        stretch_a=stretch_a,
        stretch_b=stretch_b,
        meeting=_meetings(lanes, number, length, ahead),
    )


@owner_cache
def road_index(road: Road) -> LaneRelations:
    """Return the relations of a road's vehicle lanes, cached with it."""
    return lane_relations(sorted(road.vehicle_lanes.values(), key=lambda lane: lane.lane_id))


def _ways(lanes: Sequence[Lane], number: dict[int, int], length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``ahead`` and ``loop``."""
    following = [[number[i] for i in dict.fromkeys(lane.successors) if i in number] for lane in lanes]
    tails = np.repeat(np.arange(len(lanes)), [len(heads) for heads in following])
    heads = np.array([head for heads in following for head in heads], dtype=np.int64)
    graph = coo_array((length[tails], (tails, heads)), shape=(len(lanes), len(lanes)))
    ahead = dijkstra(graph.tocsr())
    again = [ahead[after, k].min(initial=np.inf) for k, after in enumerate(following)]
    return ahead, length + np.array(again, dtype=np.float64)


def _neighbours(lanes: Sequence[Lane], number: dict[int, int]) -> list[tuple[int, int, int]]:
    left: dict[int, int] = {}
    right: dict[int, int] = {}
    for k, lane in enumerate(lanes):
        for table, back, other in zip((left, right), (right, left), lane.beside, strict=True):
            if other is not None and other in number:
                table[k] = number[other]
                back.setdefault(number[other], k)
    hops_of: dict[tuple[int, int], int] = {}
    for sign, table in ((1, left), (-1, right)):
        reached = {k: k for k in range(len(lanes))}
        for hops in range(1, SIDEWAYS + 1):
            reached = {k: table[here] for k, here in reached.items() if here in table}
            for k, other in reached.items():
                if other != k:
                    hops_of.setdefault((k, other), sign * hops)
    neighbours = [(*pair, hops) for pair, hops in hops_of.items()]
    return sorted(neighbours, key=lambda neighbour: (abs(neighbour[2]), neighbour))


def _beside(
    lanes: Sequence[Lane], number: dict[int, int], length: FloatArray, ahead: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    count = len(lanes)
    side, lead = np.zeros((count, count), dtype=np.int64), np.zeros((count, count))
    stretch_a, stretch_b = np.ones((count, count)), np.ones((count, count))
    # From the end of one lane to the start of the other, the shorter way.
    onward = ahead - length[:, None]
    np.fill_diagonal(onward, 0.0)
    gap = np.minimum(onward, onward.T)
    position = np.where(onward <= onward.T, ahead, -ahead.T)
    nearest = np.full((count, count), np.inf)
    every = np.arange(count)
    for a, b, hops in _neighbours(lanes, number):
        ratio = length[a] / length[b] if length[b] > 0 else 1.0
        for first, second, shift, from_a, from_b, direction in (
            (every, b, position[:, a], 1.0, ratio, gap[:, a]),
            (a, every, position[b] * ratio, 1.0, ratio, gap[b]),
        ):
            better = (direction < nearest[first, second]) & (direction <= BESIDE_M)
            for table, value in ((side, hops), (lead, shift), (stretch_a, from_a), (stretch_b, from_b)):
                table[first, second] = np.where(better, value, table[first, second])
            nearest[first, second] = np.where(better, direction, nearest[first, second])
    lower = np.tril_indices(count, -1)  # seen from the other vehicle
    side[lower], lead[lower] = -side.T[lower], -lead.T[lower]
    stretch_a[lower], stretch_b[lower] = stretch_b.T[lower], stretch_a.T[lower]
    np.fill_diagonal(side, 0)
    return side, lead, stretch_a, stretch_b


def _meetings(
    lanes: Sequence[Lane], number: dict[int, int], length: FloatArray, ahead: FloatArray
) -> FloatArray:
    count = len(lanes)
    table = np.full((count, count, CONFLICTS, 2), np.inf)
    by_id = {lane.lane_id: lane for lane in lanes}
    places = []
    for conflict in _conflicts_ahead(by_id):
        s = _meeting_place(conflict, by_id)
        first, second = (number[i] for i in conflict.lanes)
        places += [(first, s[0], second, s[1]), (second, s[1], first, s[0])]
    if not places:
        return table
    own, own_s, other, other_s = (np.array(column) for column in zip(*places, strict=True))
    to_place = ahead[:, own] + own_s  # (L, P)
    to_same = ahead[:, other] + other_s
    in_sight = to_place - length[:, None] <= CONFLICT_M
    other_in_sight = to_same - length[:, None] <= CONFLICT_M
    for a in range(count):
        mine = np.flatnonzero(in_sight[a])
        if not len(mine):
            continue
        theirs = np.where(other_in_sight[:, mine], to_same[:, mine], np.inf)
        keep = np.argsort(to_place[a, mine] + theirs, axis=1, kind="stable")[:, :CONFLICTS]
        table[a, :, : keep.shape[1], 1] = np.take_along_axis(theirs, keep, axis=1)
        seen = np.isfinite(table[a, :, : keep.shape[1], 1])
        table[a, :, : keep.shape[1], 0] = np.where(seen, to_place[a, mine][keep], np.inf)
    return table


def _conflicts_ahead(lanes: dict[int, Lane]) -> list[Conflict]:
    every = conflicts(lanes)
    forks = {c.lanes for c in every if c.kind == "diverge"}
    forks |= {  # forks at the map's border
        (min(i, j), max(i, j))
        for i, lane in lanes.items()
        for j in lane.conflicts
        if j in lanes and np.hypot(*(lane.centreline[0] - lanes[j].centreline[0])) < SAMPLE_M
    }
    rest = [c for c in every if c.kind != "diverge"]
    while True:
        apart = {c.lanes for c in rest if c.kind == "cross" and _parts_further(c, lanes, forks)}
        if not apart:
            return rest
        forks |= apart
        rest = [c for c in rest if c.kind == "merge" or c.lanes not in apart]


def _parts_further(conflict: Conflict, lanes: dict[int, Lane], forks: set[tuple[int, int]]) -> bool:
    (a, b), ((start_a, _), (start_b, _)) = conflict.lanes, conflict.spans
    for lane, other, start in ((a, b, start_a), (b, a, start_b)):
        before = {(min(p, other), max(p, other)) for p in lanes[lane].predecessors}
        if start < SAMPLE_M and before & forks:
            return not lines_cross(lanes[a].centreline, lanes[b].centreline)
    return False


def _meeting_place(conflict: Conflict, lanes: dict[int, Lane]) -> tuple[float, float]:
    (first_a, last_a), (first_b, last_b) = conflict.spans
    if conflict.kind == "merge":
        return first_a, first_b
    a, b = (lanes[i].centreline for i in conflict.lanes)
    arc_a, arc_b = arc_lengths(a), arc_lengths(b)
    hits, i, j = crossings_of(a, b)
    s, t = (
        arc[k] + share * np.hypot(*(line[k + 1] - line[k]).T)
        for arc, line, k, share in ((arc_a, a, i, hits.first), (arc_b, b, j, hits.second))
    )
    shared = (s >= first_a - SAMPLE_M) & (s <= last_a + SAMPLE_M)
    shared &= (t >= first_b - SAMPLE_M) & (t <= last_b + SAMPLE_M)
    if shared.any():
        earliest = int(np.argmin(np.where(shared, s, np.inf)))
        return float(s[earliest]), float(t[earliest])
    if opposed(a, b, *conflict.spans):
        return (first_a + last_a) / 2, (first_b + last_b) / 2
    s = np.linspace(first_a, last_a, int((last_a - first_a) / SAMPLE_M) + 2)
    t = np.linspace(first_b, last_b, int((last_b - first_b) / SAMPLE_M) + 2)
    apart = along(a, s)[:, None] - along(b, t)
    gap = np.hypot(apart[..., 0], apart[..., 1])
    at_a, at_b = np.unravel_index(int(np.argmin(gap)), gap.shape)
    return float(s[at_a]), float(t[at_b])
