"""Topology of a SUMO net: rows of lanes cut into edges and junctions, and the paths through junctions.

SUMO separates vehicles only if merged traffic drives over an edge before it forks, so no piece of a junction
may have several ways in and out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from scex_sumo.base.errors import MapError
from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

Piece: TypeAlias = tuple[int, int, int]  # row, piece of the row, lane within the row
Node = TypeVar("Node", bound=Any)

STUB_M = 2.0  # longest road piece cut off a junction piece where a lane begins or ends inside a conflict
SHORTEST_M = 0.1  # edge that SUMO takes
SNAP_M = 0.3  # road pieces shorter than this are left to the junction piece beside them


class Groups(Generic[Node]):
    """Disjoint groups of things, each named by its smallest member."""

    def __init__(self) -> None:
        self.above: dict[Node, Node] = {}

    def name(self, member: Node) -> Node:
        """Return the smallest member of a thing's group; its own group is new."""
        while (above := self.above.setdefault(member, member)) != member:
            member = above
        return member

    def join(self, one: Node, other: Node) -> None:
        """Make two groups one."""
        first, second = sorted((self.name(one), self.name(other)))
        self.above[second] = first


@dataclass(frozen=True, kw_only=True)
class Zone:
    """Stretches of lanes that must lie in one junction.

    Attributes:
        spans: (start, end) arc length on each of the lanes, m.
    """

    lanes: tuple[int, ...]
    spans: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """Lanes side by side, rightmost first.

    Attributes:
        lengths: of each lane, m.
        cuts: fractions of the lengths, from 0.0 to 1.0.
        inside: whether the piece between two cuts lies in a junction.
    """

    lanes: tuple[int, ...]
    lengths: tuple[float, ...]
    cuts: tuple[float, ...] = (0.0, 1.0)
    inside: tuple[bool, ...] = (False,)

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.inside)

    def span(self, piece: int, lane: int) -> tuple[float, float]:
        """Return the arc lengths of a piece on a lane (index into the row), m."""
        return self.cuts[piece] * self.lengths[lane], self.cuts[piece + 1] * self.lengths[lane]

    def size(self, piece: int) -> float:
        """Mean length of a piece, m."""
        return (self.cuts[piece + 1] - self.cuts[piece]) * float(np.mean(self.lengths))

    def with_zones(self, zones: list[tuple[float, float]]) -> Row:
        """Cut the row so that exactly these fractions (disjoint, ascending) lie in junctions."""
        cuts = sorted({0.0, 1.0, *(cut for zone in zones for cut in zone)})
        inside = [any(start <= a and b <= end for start, end in zones) for a, b in pairwise(cuts)]
        return replace(self, cuts=tuple(cuts), inside=tuple(inside))

    def with_inside(self, piece: int, inside: bool) -> Row:
        """Give one piece to the junction, or to the road."""
        return replace(self, inside=(*self.inside[:piece], inside, *self.inside[piece + 1 :]))

    def with_road(self, piece: int, cut: float) -> Row:
        """Cut a piece in two: the first half becomes road, the second stays as it was."""
        return replace(
            self,
            cuts=(*self.cuts[: piece + 1], cut, *self.cuts[piece + 1 :]),
            inside=(*self.inside[:piece], False, *self.inside[piece:]),
        )


def build_rows(lanes: Mapping[int, Lane]) -> tuple[list[Row], list[tuple[int, int]]]:
    """Group lanes by permitted lane changes.

    Returns:
        The rows, by smallest lane id; and the changes (from, to) that no row can hold, because a lane has
        another neighbour on that side.
    """
    left_of: dict[int, int] = {}
    right_of: dict[int, int] = {}
    lost = []
    for i in sorted(lanes):
        for neighbour, leftward in ((lanes[i].left, True), (lanes[i].right, False)):
            if neighbour is None or neighbour not in lanes or neighbour == i:
                continue
            right, left = (i, neighbour) if leftward else (neighbour, i)
            free = left_of.get(right, left) == left and right_of.get(left, right) == right
            if free and right not in _leftward(left_of, left):
                left_of[right], right_of[left] = left, right
            else:
                lost.append((i, neighbour))
    chains = [_leftward(left_of, i) for i in lanes if i not in right_of]
    rows = [Row(lanes=c, lengths=tuple(length_of(lanes[i].centreline) for i in c)) for c in chains]
    return sorted(rows, key=lambda row: min(row.lanes)), lost


def _leftward(left_of: Mapping[int, int], first: int) -> tuple[int, ...]:
    chain = [first]
    while chain[-1] in left_of:
        chain.append(left_of[chain[-1]])
    return tuple(chain)


def lay_zones(rows: Sequence[Row], lanes: Mapping[int, Lane], found: Sequence[Conflict | Zone]) -> list[Row]:
    """Cut rows at conflicts; lanes that begin or end inside a conflict keep a stub of road."""
    spans: dict[int, list[tuple[float, float]]] = {}
    for conflict in found:
        for lane, span in zip(conflict.lanes, conflict.spans, strict=True):
            spans.setdefault(lane, []).append(span)
    result = []
    for row in rows:
        zones = [
            (start / size, end / size)
            for lane, size in zip(row.lanes, row.lengths, strict=True)
            for start, end in spans.get(lane, ())
        ]
        begins = any(not lanes[i].predecessors for i in row.lanes)
        ends = any(not lanes[i].successors for i in row.lanes)
        zones = _tidy(zones, float(np.mean(row.lengths)), begins=begins, ends=ends)
        result.append(row.with_zones(zones))
    return result


def _tidy(
    zones: list[tuple[float, float]], size: float, *, begins: bool, ends: bool
) -> list[tuple[float, float]]:
    stub, least, gap = (min(length, size / 3) / size for length in (STUB_M, SHORTEST_M, SNAP_M))
    low = (stub if all(end > stub + gap for _, end in zones) else least) if begins else 0.0
    high = 1.0 - (stub if all(start < 1.0 - stub - gap for start, _ in zones) else least) if ends else 1.0
    merged: list[tuple[float, float]] = []
    for start, end in sorted(zones):
        start, end = (low if start < low + gap else start), (high if end > high - gap else end)
        if end - start < 1e-9:
            continue
        if merged and start <= merged[-1][1] + gap:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged


Cut: TypeAlias = tuple[int, int]  # row, cut of the row

ROOM_M = 7.5  # a car of 5 m and SUMO's default gap of 2.5 m
NARROW_M = 4.0
MAX_LINKS = 256  # of one junction; SUMO refuses a net with more
MAX_STEPS = 100_000  # of a search through one junction; damaged maps have exponentially many ways


@dataclass(frozen=True, kw_only=True)
class Path:
    """A way through a node, from road piece over junction pieces to road piece: a SUMO connection."""

    start: Piece
    inside: tuple[Piece, ...]
    end: Piece

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """All pieces in driving order."""
        return (self.start, *self.inside, self.end)


class _Chains:
    def __init__(self, rows: Sequence[Row], lanes: Mapping[int, Lane]) -> None:
        self.rows = list(rows)
        self.lanes = lanes
        self.where = {i: (r, k) for r, row in enumerate(rows) for k, i in enumerate(row.lanes)}

    def is_inside(self, piece: Piece) -> bool:
        return self.rows[piece[0]].inside[piece[1]]

    def pieces(self) -> Iterator[Piece]:
        for r, row in enumerate(self.rows):
            yield from ((r, k, at) for k in range(row.pieces) for at in range(len(row.lanes)))

    def road_pieces(self) -> Iterator[Piece]:
        return (piece for piece in self.pieces() if not self.is_inside(piece))

    def ways_from(self, start: Piece) -> Iterator[tuple[Piece, tuple[Piece, ...]]]:
        stack: list[tuple[Piece, ...]] = [(start,)]
        for _ in range(MAX_STEPS):
            if not stack:
                return
            way = stack.pop()
            for piece in self.after(way[-1]):
                if not self.is_inside(piece):
                    yield piece, way[1:]
                elif piece not in way:  # a ring that lies completely inside one junction
                    stack.append((*way, piece))
        raise self.too_large(start)

    def too_large(self, piece: Piece) -> MapError:
        return MapError(
            f"lanelet {self.rows[piece[0]].lanes[piece[2]]}: its junction would have more than {MAX_LINKS} "
            "connections, which SUMO refuses; remove lanelets that overlap or meet there by mistake"
        )

    def after(self, piece: Piece) -> list[Piece]:
        row, k, at = piece
        if k + 1 < self.rows[row].pieces:
            return [(row, k + 1, at)]
        lanes = self.lanes[self.rows[row].lanes[at]].successors
        return [(self.where[i][0], 0, self.where[i][1]) for i in lanes if i in self.where]

    def before(self, piece: Piece) -> list[Piece]:
        row, k, at = piece
        if k:
            return [(row, k - 1, at)]
        lanes = self.lanes[self.rows[row].lanes[at]].predecessors
        found = [self.where[i] for i in lanes if i in self.where]
        return [(r, self.rows[r].pieces - 1, at) for r, at in found]

    def unsound(self, pieces: Iterable[Piece]) -> set[Piece]:
        after: dict[Piece, list[Piece]] = {}
        before: dict[Piece, list[Piece]] = {}
        stack = [*pieces]
        while stack:
            piece = stack.pop()
            if piece not in after and self.is_inside(piece):
                after[piece], before[piece] = self.after(piece), self.before(piece)
                stack += (*after[piece], *before[piece])
        out, into = _roads_behind(after, before), _roads_behind(before, after)
        knots = [p for p in after if len(out[p]) > 1 and len(into[p]) > 1]
        return reached(knots, after) | reached(knots, before) | _on_rings(after)


_Steps: TypeAlias = Mapping[Piece, Sequence[Piece]]


def _roads_behind(steps: _Steps, back: _Steps) -> dict[Piece, set[Piece]]:
    roads = {piece: {p for p in onward if p not in steps} for piece, onward in steps.items()}
    stack = [piece for piece, behind in roads.items() if behind]
    while stack:
        piece = stack.pop()
        for other in back[piece]:
            if other in roads and len(roads[other]) < 2 and not roads[piece] <= roads[other]:
                roads[other] |= roads[piece]
                stack.append(other)
    return roads


def reached(nodes: Iterable[Node], steps: Mapping[Node, Iterable[Node]]) -> set[Node]:
    """Return the nodes, and what one gets to from them; nodes without steps of their own are left out."""
    found: set[Node] = set()
    stack = [*nodes]
    while stack:
        node = stack.pop()
        if node not in found and node in steps:
            found.add(node)
            stack += steps[node]
    return found


def endless(after: Mapping[Node, Collection[Node]]) -> set[Node]:
    """Return the nodes of a graph on its rings, and those that lead to them."""
    order = TopologicalSorter({node: [n for n in onward if n in after] for node, onward in after.items()})
    with suppress(CycleError):
        order.prepare()
    ends = set[Node]()
    while ready := order.get_ready():
        ends.update(ready)
        order.done(*ready)
    return {*after} - ends


def _on_rings(after: _Steps) -> set[Piece]:
    return {piece for piece in endless(after) if piece in reached(after[piece], after)}


class Topology(_Chains):
    """Graph of cut rows."""

    def __init__(
        self, rows: Sequence[Row], lanes: Mapping[int, Lane], zones: Sequence[Conflict | Zone]
    ) -> None:
        super().__init__(rows, lanes)
        self._nodes: Groups[Cut] = Groups()
        self._join_cuts(zones)

    def lane(self, piece: Piece) -> Lane:
        """Return the lane of a piece."""
        return self.lanes[self.rows[piece[0]].lanes[piece[2]]]

    def span(self, piece: Piece) -> tuple[float, float]:
        """Return the arc lengths of a piece on its lane, m."""
        return self.rows[piece[0]].span(*piece[1:])

    def node(self, row: int, cut: int) -> Cut:
        """Return the node of a cut of a row, named by its first cut."""
        return self._nodes.name((row, cut))

    def paths_by_node(self) -> dict[Cut, list[Path]]:
        """Return the paths through each node."""
        nodes: dict[Cut, list[Path]] = {}
        for start in self.road_pieces():
            for end, inside in self.ways_from(start):
                node = self.node(start[0], start[1] + 1)
                paths = nodes.setdefault(node, [])
                paths.append(Path(start=start, inside=inside, end=end))
                if len(paths) > MAX_LINKS:
                    raise self.too_large(start)
        return nodes

    def pieces_on(self, lane_id: int, start: float, end: float) -> list[Piece]:
        """Return the junction pieces that share some of a stretch of a lane, m."""
        row, at = self.where[lane_id]
        pieces = [(row, k, at) for k, inside in enumerate(self.rows[row].inside) if inside]
        spans = map(self.span, pieces)
        return [
            piece
            for piece, (low, high) in zip(pieces, spans, strict=True)
            if min(high, end) - max(low, start) > -1e-6
        ]

    def _join_cuts(self, zones: Sequence[Conflict | Zone]) -> None:
        for r, row in enumerate(self.rows):
            for k, inside in enumerate(row.inside):
                if inside:
                    self._nodes.join((r, k), (r, k + 1))
            for i in row.lanes:
                for j in self.lanes[i].successors:
                    if j in self.where:
                        self._nodes.join((r, row.pieces), (self.where[j][0], 0))
        for zone in zones:
            spans = zip(zone.lanes, zone.spans, strict=True)
            touched = [piece for lane, span in spans for piece in self.pieces_on(lane, *span)]
            for piece in touched[1:]:
                self._nodes.join(touched[0][:2], piece[:2])


def cut_lanes(
    lanes: Mapping[int, Lane], found: Sequence[Conflict], walked: Sequence[Zone] = ()
) -> tuple[Topology, list[tuple[int, int]]]:
    """Cut lanes into roads and junctions, by conflicts, crosswalks (``walked``) and SUMO's needs.

    Returns:
        The graph, and the permitted lane changes (from, to) that it cannot hold.
    """
    rows, lost = build_rows(lanes)
    closed = {i for row in lay_zones(rows, lanes, found) if all(row.inside) for i in row.lanes}
    # Lanes without a stretch clear of other traffic: the edge for their changes would hide a conflict.
    inside = [(i, j) for i in sorted(closed) for j in (lanes[i].left, lanes[i].right) if j is not None]
    lost += [change for change in inside if change not in lost]
    lanes = {i: replace(x, left=None, right=None) if i in closed else x for i, x in lanes.items()}
    rows, _ = build_rows(lanes)
    zones: list[Conflict | Zone] = [*found, *walked]
    rows = [  # lanes side by side need some road to change on
        _opened(row, 0) if len(row.lanes) > 1 and all(row.inside) else row
        for row in lay_zones(rows, lanes, zones)
    ]
    rows = _open_knots(rows, lanes)
    rows = _fill_gaps(Topology(rows, lanes, zones))
    rows = _split_loops(Topology(rows, lanes, zones))
    return Topology(rows, lanes, zones), lost


def _fill_gaps(topology: Topology) -> list[Row]:
    chains, node = _Chains(topology.rows, topology.lanes), topology.node
    for _, r, k in sorted(_gaps(chains)):
        row = chains.rows[r]
        if row.size(k) > NARROW_M and node(r, k) != node(r, k + 1):
            continue
        if len(row.lanes) > 1 and row.inside.count(False) == 1:
            continue  # its only place for changing lanes
        chains.rows[r] = row.with_inside(k, True)
        pieces = {(r, k, at) for at in range(len(row.lanes))}
        if pieces & chains.unsound(pieces):
            chains.rows[r] = row
    return chains.rows


def _split_loops(topology: Topology) -> list[Row]:
    result, node = [], topology.node
    for r, row in enumerate(topology.rows):
        halved = row
        for k in reversed(range(row.pieces)):
            if not row.inside[k] and node(r, k) == node(r, k + 1):
                halved = halved.with_road(k, (row.cuts[k] + row.cuts[k + 1]) / 2)
        result.append(halved)
    return result


def _gaps(chains: _Chains) -> Iterator[tuple[float, int, int]]:
    for r, row in enumerate(chains.rows):
        for k, inside in enumerate(row.inside):
            pieces = [(r, k, at) for at in range(len(row.lanes))]
            if inside or row.size(k) >= ROOM_M:
                continue
            enclosed = all(
                any(chains.is_inside(p) for p in chains.before(piece))
                and any(chains.is_inside(p) for p in chains.after(piece))
                for piece in pieces
            )
            if enclosed:
                yield row.size(k), r, k


def _open_knots(rows: Sequence[Row], lanes: Mapping[int, Lane]) -> list[Row]:
    """Cut edges into junction pieces until SUMO can handle every junction.

    These are pieces where traffic merges and forks again, and double ways between the same two road pieces.
    """
    chains = _Chains(rows, lanes)
    for _ in range(sum(row.pieces for row in rows)):
        knot = _knot(chains)
        twins = [] if knot else _double_way(chains)
        if knot:
            chains.rows[knot[0]] = _opened(chains.rows[knot[0]], knot[1])
        elif not twins:
            break
        for r, k in twins:
            chains.rows[r] = chains.rows[r].with_inside(k, False)
    return chains.rows


def _knot(chains: _Chains) -> tuple[int, int] | None:
    candidates = []
    for r, k in {piece[:2] for piece in chains.unsound(chains.pieces())}:
        merging = any(len(chains.before((r, k, at))) > 1 for at in range(len(chains.rows[r].lanes)))
        candidates.append((merging, chains.rows[r].size(k), -r, -k))
    _, _, r, k = max(candidates, default=(False, 0.0, 1, 1))
    return (-r, -k) if r <= 0 else None


def _double_way(chains: _Chains) -> list[tuple[int, int]]:
    for start in chains.road_pieces():
        ways: dict[Piece, tuple[Piece, ...]] = {}
        for end, way in chains.ways_from(start):
            other = ways.setdefault(end, way)
            apart = [[p for p in a if p not in b] for a, b in ((way, other), (other, way))]
            longest = [max(p, key=lambda q: (chains.rows[q[0]].size(q[1]), q)) for p in apart if p]
            if longest:
                return sorted({piece[:2] for piece in longest})
    return []


def _opened(row: Row, piece: int) -> Row:
    start, end = row.cuts[piece], row.cuts[piece + 1]
    return row.with_road(piece, start + (end - start) * min(STUB_M / row.size(piece), 1 / 3))
