"""Right of way at a node: SUMO's foes, responses and link states; roundabouts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from scex_sumo.geometry.polylines import along, length_of, project, samples, turn, without_repeats
from scex_sumo.lanelet2sumo.plan.elements import Connection
from scex_sumo.lanelet2sumo.topology.graph import Path, Piece, Topology, endless, reached
from scex_sumo.road import Lane, Regulation
from scex_sumo.roads.conflicts import Conflict
from scex_sumo.roads.places import way_round

REACH_M = 30.0  # how far before a node a rule may be attached to the approach
SAME_WAY = math.radians(45.0)  # approaches closer than this in heading run alongside each other
ONCOMING = math.radians(135.0)
STRAIGHT = math.radians(20.0)
MIN_ROUNDNESS = 0.85  # area over that of a circle with the same circumference; a square has 0.79
MAX_ONCOMING = 0.2  # of a roundabout's length that has oncoming lanes beside it; blocks have over 0.3
BESIDE_M = 10.0


def approach(topology: Topology, path: Path, *, forks: bool = False) -> frozenset[int]:
    """Return lanelets on a path and up to 30 m before it, as far as no other way joins in between.

    With ``forks`` it goes on before forks, where a rule may mean another way.
    """
    lanelets = {topology.lane(piece).lane_id for piece in (path.start, *path.inside)}
    lane, reach = topology.lane(path.start), 0.0
    while reach < REACH_M:
        row, index = topology.where[lane.lane_id]
        reach += topology.rows[row].lengths[index]
        before = lane.predecessors
        if len(before) != 1 or before[0] not in topology.where or before[0] in lanelets:
            break
        lane = topology.lanes[before[0]]
        if len(lane.successors) != 1 and not forks:
            break
        lanelets.add(lane.lane_id)
    return frozenset(lanelets)


def set_foes(links: Sequence[Connection], clashes: Mapping[tuple[Piece, Piece], str]) -> set[frozenset[int]]:
    """Fill ``foes`` of the links of one node; return the pairs of foes that only merge."""
    merging: set[frozenset[int]] = set()
    for i, a in enumerate(links):
        for j in range(i):
            b = links[j]
            if a.path.start == b.path.start:
                continue  # one behind the other: SUMO follows leaders there
            kinds = {clashes[p, q] for p in a.path.inside for q in b.path.inside if (p, q) in clashes}
            if a.path.end == b.path.end or set(a.path.inside) & set(b.path.inside):
                kinds.add("merge")
            if kinds:
                a.foes.add(j)
                b.foes.add(i)
            if kinds == {"merge"}:
                merging.add(frozenset((i, j)))
    return merging


def clashing_pieces(topology: Topology, conflicts: Sequence[Conflict]) -> dict[tuple[Piece, Piece], str]:
    """Return the kind of conflict between junction pieces, both ways round; crossing overrides merging."""
    kinds: dict[tuple[Piece, Piece], str] = {}
    for c in conflicts:
        first, second = (topology.pieces_on(lane, *s) for lane, s in zip(c.lanes, c.spans, strict=True))
        for p in first:
            for q in second:
                if kinds.get((p, q)) != "cross":
                    kinds[p, q] = kinds[q, p] = c.kind
    return kinds


def set_right_of_way(
    links: Sequence[Connection], merging: set[frozenset[int]], rules: Sequence[Regulation]
) -> None:
    """Fill ``response`` and ``state`` from the rules, or from defaults if there are none.

    Defaults: roundabouts go first, equal merges are zippers, crossings are right before left, and left turns
    yield to oncoming traffic. Links yield to each other only at all-way stops and zippers.
    """
    ruled: set[frozenset[int]] = set()
    for i, a in enumerate(links):
        for j in a.foes:
            if (yields := _by_rule(a, links[j], rules)) is not None:
                ruled.add(frozenset((i, j)))
                a.response |= {j} if yields else set()
    zippers = _zippers(links, merging, ruled)
    for i, a in enumerate(links):
        for j in a.foes:
            if frozenset((i, j)) not in ruled and (i in zippers or _by_default(a, links[j], i > j)):
                a.response.add(j)
    waits = {i: a.response for i, a in enumerate(links)}
    for i, a in enumerate(links):
        a.state = _state(a, i, rules, zippers, circular=i in reached(a.response, waits))


def _by_rule(a: Connection, b: Connection, rules: Sequence[Regulation]) -> bool | None:
    """Return whether link a yields to link b, as both do at an all-way stop; None if no rule says it."""
    mine = theirs = across = ahead = 0
    for rule in rules:
        if rule.kind == "all_way_stop":
            stopping = {*rule.lanes, *rule.yielding}
            if a.on & stopping and b.on & stopping:
                return True
            continue
        yielding = set(rule.yielding) or (set(rule.lanes) if rule.kind in ("stop", "yield") else set())
        sides = yielding, set(rule.priority)
        mine, theirs = max(mine, _weight(a.on, b.on, *sides)), max(theirs, _weight(b.on, a.on, *sides))
        for lanelets, others in ((a.across, b.on), (a.on, b.across)):
            across += (_weight(lanelets, others, *sides) == 2) - (_weight(others, lanelets, *sides) == 2)
        for lanelets, others, sign in ((a.before, b.before, 1), (b.before, a.before, -1)):
            ahead += sign * (_weight(lanelets, others, *sides) == 2)
    # Rules of the approaches mean other ways across: those that name these ways decide, then those that name
    # both approaches.
    for named in (across, ahead):
        if mine == theirs or (named and max(mine, theirs) < 2):
            mine, theirs = 2 * max(named, 0), 2 * max(-named, 0)
    return None if mine == theirs else mine > theirs


def _weight(a: frozenset[int], b: frozenset[int], yielding: set[int], priority: set[int]) -> int:
    if not a & yielding or (a & priority and not b & priority):
        return 0
    # A rule for a whole junction may name b on both sides: it yields to others, but not to a.
    if b & priority and not (b & yielding and a & priority):
        return 2
    return 0 if b & yielding else 1


def _zippers(
    links: Sequence[Connection], merging: set[frozenset[int]], ruled: set[frozenset[int]]
) -> set[int]:
    free = merging - ruled

    def alike(i: int, j: int) -> bool:
        a, b = links[i], links[j]
        near = a.on_ring == b.on_ring and abs(turn(a.entry, b.entry)) < SAME_WAY
        return near and frozenset((i, j)) in free

    good = {i for i, a in enumerate(links) if a.foes and all(alike(i, j) for j in a.foes)}
    while (kept := {i for i in good if links[i].foes <= good}) != good:
        good = kept
    return good


def _by_default(a: Connection, b: Connection, tie: bool) -> bool:
    if a.on_ring != b.on_ring:
        return b.on_ring
    side = turn(a.entry, b.entry)
    if SAME_WAY <= abs(side) <= ONCOMING:
        return side > 0  # b heads to a's left: it comes from the right
    left_a, left_b = (a.bend, b.bend) if abs(side) > ONCOMING else (abs(a.bend), abs(b.bend))
    if abs(left_a - left_b) > STRAIGHT:
        return left_a > left_b
    return side > 0 if side != 0 else tie


def _state(
    link: Connection, index: int, rules: Sequence[Regulation], zippers: set[int], *, circular: bool
) -> str:
    kinds = {rule.kind for rule in rules if link.on & (set(rule.yielding) or set(rule.lanes))}
    if index in zippers:
        return "Z"
    if not link.response:
        return "M"
    if "all_way_stop" in kinds or "stop" in kinds:
        return "w" if "all_way_stop" in kinds else "s"
    # SUMO looks for a way out of circular waiting only where the state says right before left.
    return "=" if circular else "m"


def ring_lanes(lanes: Mapping[int, Lane]) -> frozenset[int]:
    """Return the lanes of roundabouts: short, round cycles of successors without oncoming lanes beside."""
    sizes = {i: length_of(lane.centreline) for i, lane in lanes.items()}
    lines = shapely.STRtree([shapely.LineString(lane.centreline) for lane in lanes.values()])
    ring: set[int] = set()
    for i in sorted(endless({i: lane.successors for i, lane in lanes.items()})):
        if i not in ring:
            cycle = way_round(lanes, sizes, i)
            is_round = cycle and _roundness(lanes, cycle) >= MIN_ROUNDNESS
            if is_round and _oncoming_share(lanes, lines, cycle) < MAX_ONCOMING:
                ring.update(cycle)
    return frozenset(ring)


def _oncoming_share(lanes: Mapping[int, Lane], lines: shapely.STRtree, cycle: list[int]) -> float:
    """Share of a cycle beside which traffic drives the other way: a block of houses has streets around it."""
    ring, ids = without_repeats(np.vstack([lanes[i].centreline for i in cycle])), list(lanes)
    met: set[int] = set()
    area = shapely.Polygon(ring).buffer(BESIDE_M)
    for i in {ids[k] for k in lines.query(area, predicate="intersects").tolist()}.difference(cycle):
        _, points = samples(lanes[i].centreline, 1.0)
        s, aside = project(points, ring)
        step, step_there = np.gradient(points, axis=0), along(ring, s + 0.5) - along(ring, s - 0.5)
        against = (step * step_there).sum(axis=1) < math.cos(ONCOMING) * np.hypot(*step.T)
        met.update(np.floor(s[against & (aside < BESIDE_M)]).astype(int).tolist())
    return len(met) / length_of(ring)


def _roundness(lanes: Mapping[int, Lane], cycle: list[int]) -> float:
    ring = shapely.Polygon(np.vstack([lanes[i].centreline for i in cycle]))
    return float(4 * math.pi * ring.area / max(ring.length, 1e-9) ** 2)
