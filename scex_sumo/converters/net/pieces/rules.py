"""Right of way at a node: SUMO's foes, responses and link states from the map's rules."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scex_sumo.converters.net.pieces.rows import Piece
from scex_sumo.converters.net.pieces.topology import Path, Topology
from scex_sumo.geometry.polylines import turn
from scex_sumo.road import Regulation
from scex_sumo.roads.conflicts import Conflict

REACH_M = 30.0  # how far before a node a rule may be attached to the approach
SAME_WAY = math.radians(45.0)  # approaches closer than this in heading run alongside each other
ONCOMING = math.radians(135.0)
STRAIGHT = math.radians(20.0)


@dataclass(kw_only=True, eq=False)
class Link:
    """A connection as SUMO's right of way sees it.

    Attributes:
        path: the path.
        entry: heading where the path enters the node, rad.
        bend: signed change of heading along the path, rad, positive to the left.
        on: lanelets whose rules apply: those of the path and the approach.
        on_ring: whether it comes from within a roundabout.
        foes: indices of links in the way of this one.
        response: indices of foes that this one gives way to.
        state: SUMO's link state, e.g. ``M`` (priority), ``m`` (yields), ``Z`` (zipper).
    """

    path: Path
    entry: float
    bend: float
    on: frozenset[int]
    on_ring: bool = False
    foes: set[int] = field(default_factory=set)
    response: set[int] = field(default_factory=set)
    state: str = "M"


def approach(topology: Topology, path: Path) -> frozenset[int]:
    """Lanelets on a path and up to 30 m before it, where no other way joins in between."""
    found = {topology.lane_id(piece) for piece in (path.start, *path.inside)}
    lane, reach = topology.lane_id(path.start), 0.0
    while reach < REACH_M:
        row, at = topology.where[lane]
        reach += topology.rows[row].lengths[at]
        previous = topology.lanes[lane].predecessors
        if len(previous) != 1 or previous[0] not in topology.where or previous[0] in found:
            break
        lane = previous[0]
        if len(topology.lanes[lane].successors) != 1:
            break
        found.add(lane)
    return frozenset(found)


def set_foes(links: Sequence[Link], clashes: Mapping[tuple[Piece, Piece], str]) -> list[set[frozenset[int]]]:
    """Fill ``foes``.

    Args:
        links: the links of one node.
        clashes: kind of conflict between junction pieces, from `clashing_pieces`.

    Returns:
        For each link the pairs of it and a foe that merely merge.
    """
    merging: list[set[frozenset[int]]] = [set() for _ in links]
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
                merging[i].add(frozenset((i, j)))
                merging[j].add(frozenset((i, j)))
    return merging


def clashing_pieces(topology: Topology, found: Sequence[Conflict]) -> dict[tuple[Piece, Piece], str]:
    """Kind of conflict between junction pieces, both ways round; crossing wins over merging."""
    kinds: dict[tuple[Piece, Piece], str] = {}
    for c in found:
        first, second = (topology.pieces_on(lane, *s) for lane, s in zip(c.lanes, c.spans, strict=True))
        for p in first:
            for q in second:
                if kinds.get((p, q)) != "cross":
                    kinds[p, q] = kinds[q, p] = c.kind
    return kinds


def set_right_of_way(
    links: Sequence[Link], merging: Sequence[set[frozenset[int]]], rules: Sequence[Regulation]
) -> None:
    """Fill ``response`` and ``state`` from the regulations, and from the defaults where there are none.

    Defaults: a roundabout goes before its entries, equal merges are zippers, crossings are right before
    left, left turns give way to oncoming traffic. Only all-way stops and zippers make two links give way to
    each other.
    """
    ruled: set[frozenset[int]] = set()
    for i, a in enumerate(links):
        for j in a.foes:
            verdict = _by_rule(a, links[j], rules)
            if verdict:
                ruled.add(frozenset((i, j)))
                if verdict in ("yields", "both"):
                    a.response.add(j)
    zippers = _zippers(links, merging, ruled)
    for i, a in enumerate(links):
        for j in a.foes:
            if frozenset((i, j)) not in ruled and (i in zippers or _by_default(a, links[j], i > j)):
                a.response.add(j)
    for i, a in enumerate(links):
        a.state = _state(a, i, rules, zippers, _waits_for_itself(links, i))


def _by_rule(a: Link, b: Link, rules: Sequence[Regulation]) -> str:
    """``yields``, ``has priority``, ``both`` (all-way stop) or nothing, for link a against link b."""
    mine, theirs = 0, 0
    for rule in rules:
        if rule.kind == "all_way_stop":
            stopping = {*rule.lanes, *rule.yielding}
            if a.on & stopping and b.on & stopping:
                return "both"
            continue
        yielding = set(rule.yielding) or (set(rule.lanes) if rule.kind in ("stop", "yield") else set())
        mine = max(mine, _weight(a, b, yielding, set(rule.priority)))
        theirs = max(theirs, _weight(b, a, yielding, set(rule.priority)))
    if mine == theirs:
        return ""
    return "yields" if mine > theirs else "has priority"


def _weight(a: Link, b: Link, yielding: set[int], priority: set[int]) -> int:
    """How strongly a rule tells a to give way to b: 2 by naming both, 1 by naming a alone."""
    if not a.on & yielding or (a.on & priority and not b.on & priority):
        return 0
    if b.on & priority and not b.on & yielding:
        return 2
    return 0 if b.on & yielding else 1


def _zippers(
    links: Sequence[Link], merging: Sequence[set[frozenset[int]]], ruled: set[frozenset[int]]
) -> set[int]:
    """Links whose foes all come alongside and merge with them, by equal right."""
    good = {
        i
        for i, a in enumerate(links)
        if a.foes
        and all(
            frozenset((i, j)) in merging[i]
            and frozenset((i, j)) not in ruled
            and a.on_ring == links[j].on_ring
            and abs(turn(a.entry, links[j].entry)) < SAME_WAY
            for j in a.foes
        )
    }
    while True:
        kept = {i for i in good if links[i].foes <= good}
        if kept == good:
            return good
        good = kept


def _by_default(a: Link, b: Link, tie: bool) -> bool:
    """Whether a gives way to b where no rule says so; exactly one of the two does."""
    if a.on_ring != b.on_ring:
        return b.on_ring
    side = turn(a.entry, b.entry)
    if SAME_WAY <= abs(side) <= ONCOMING:
        return side > 0  # b heads to a's left: it comes from the right
    left_a, left_b = (a.bend, b.bend) if abs(side) > ONCOMING else (abs(a.bend), abs(b.bend))
    if abs(left_a - left_b) > STRAIGHT:
        return left_a > left_b
    return side > 0 if side != 0 else tie


def _state(link: Link, index: int, rules: Sequence[Regulation], zippers: set[int], circular: bool) -> str:
    kinds = {rule.kind for rule in rules if link.on & (set(rule.yielding) or set(rule.lanes))}
    if index in zippers:
        return "Z"
    if "all_way_stop" in kinds and link.response:
        return "w"
    if "stop" in kinds and link.response:
        return "s"
    if not link.response:
        return "M"
    # SUMO looks for a way out of circular waiting only where the state says right before left.
    return "=" if circular else "m"


def _waits_for_itself(links: Sequence[Link], index: int) -> bool:
    """Whether a link gives way to one that gives way ... to it, as four at a crossing do."""
    seen: set[int] = set()
    stack = list(links[index].response)
    while stack:
        i = stack.pop()
        if i not in seen:
            seen.add(i)
            stack += links[i].response
    return index in seen


def bits(indices: set[int], count: int) -> str:
    """SUMO's bit string: index 0 is the rightmost character."""
    return "".join("1" if i in indices else "0" for i in reversed(range(count)))


def direction(bend: float) -> str:
    """SUMO's turn direction of a change of heading, rad."""
    degrees = math.degrees(bend)
    if abs(degrees) < 25:
        return "s"
    if abs(degrees) > 165:
        return "t"
    letter = "l" if degrees > 0 else "r"
    return letter.upper() if abs(degrees) < 50 else letter


def links_by_node(topology: Topology) -> Mapping[tuple[int, int], list[Path]]:
    """Paths of every node, in the order of SUMO's link indices."""
    nodes: dict[tuple[int, int], list[Path]] = {}
    for path in topology.paths:
        nodes.setdefault(topology.path_node(path), []).append(path)
    return nodes
