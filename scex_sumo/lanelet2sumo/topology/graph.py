"""Topology of a SUMO net: the graph of cut rows, and the paths through junctions.

SUMO separates vehicles only if merged traffic drives over an edge before it forks, so no piece of a junction
may have several ways in and out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Any, Generic, TypeAlias, TypeVar

from scex_sumo.base.errors import MapError
from scex_sumo.lanelet2sumo.topology.rows import Row, Zone
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

Piece: TypeAlias = tuple[int, int, int]  # row, piece of the row, lane within the row
Node = TypeVar("Node", bound=Any)


class Groups(Generic[Node]):
    """Disjoint groups of things, each named by its smallest member."""

    def __init__(self) -> None:
        self.above: dict[Node, Node] = {}

    def name(self, member: Node) -> Node:
        """Return the smallest member of a thing's group; its own group is new."""
        while (above := self.above.setdefault(member, member)) != member:
            member = above
        return member

    def join(self, member: Node, other: Node) -> None:
        """Make two groups one."""
        first, second = sorted((self.name(member), self.name(other)))
        self.above[second] = first


Cut: TypeAlias = tuple[int, int]  # row, cut of the row

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
    seen: set[Node] = set()
    stack = [*nodes]
    while stack:
        node = stack.pop()
        if node not in seen and node in steps:
            seen.add(node)
            stack += steps[node]
    return seen


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


class Topology:
    """Graph of rows as chains of pieces, which may be cut further."""

    def __init__(
        self, rows: Sequence[Row], lanes: Mapping[int, Lane], zones: Sequence[Conflict | Zone] = ()
    ) -> None:
        """Build the graph; nodes are those of the rows as they are given, joined where ``zones`` lie."""
        self.rows = list(rows)
        self.lanes = lanes
        self.where = {i: (r, k) for r, row in enumerate(rows) for k, i in enumerate(row.lanes)}
        self._nodes: Groups[Cut] = Groups()
        self._join_cuts(zones)

    def is_inside(self, piece: Piece) -> bool:
        """Return whether a piece lies in a junction."""
        return self.rows[piece[0]].inside[piece[1]]

    def pieces(self, *, road: bool = False) -> Iterator[Piece]:
        """Yield all pieces, or those of roads."""
        for r, row in enumerate(self.rows):
            kept = (k for k in range(row.pieces) if not (road and row.inside[k]))
            yield from ((r, k, index) for k in kept for index in range(len(row.lanes)))

    def ways_from(self, start: Piece) -> Iterator[tuple[Piece, tuple[Piece, ...]]]:
        """Yield the road piece at the end of each way through a junction, and the pieces between."""
        stack: list[tuple[Piece, ...]] = [(start,)]
        for _ in range(MAX_STEPS):
            if not stack:
                return
            chain = stack.pop()
            for piece in self.after(chain[-1]):
                if not self.is_inside(piece):
                    yield piece, chain[1:]
                elif piece not in chain:  # a ring that lies completely inside one junction
                    stack.append((*chain, piece))
        raise self.too_large(start)

    def too_large(self, piece: Piece) -> MapError:
        """Error about a junction with more connections than SUMO takes."""
        return MapError(
            f"lanelet {self.rows[piece[0]].lanes[piece[2]]}: its junction would have more than {MAX_LINKS} "
            "connections, which SUMO refuses; remove lanelets that overlap or meet there by mistake"
        )

    def after(self, piece: Piece) -> list[Piece]:
        """Return the pieces that follow a piece."""
        row, k, index = piece
        if k + 1 < self.rows[row].pieces:
            return [(row, k + 1, index)]
        lanes = self.lanes[self.rows[row].lanes[index]].successors
        return [(self.where[i][0], 0, self.where[i][1]) for i in lanes if i in self.where]

    def before(self, piece: Piece) -> list[Piece]:
        """Return the pieces that a piece follows."""
        row, k, index = piece
        if k:
            return [(row, k - 1, index)]
        lanes = self.lanes[self.rows[row].lanes[index]].predecessors
        places = [self.where[i] for i in lanes if i in self.where]
        return [(r, self.rows[r].pieces - 1, index) for r, index in places]

    def unsound(self, pieces: Iterable[Piece]) -> set[Piece]:
        """Return the pieces of junctions, near some pieces, that SUMO cannot handle: knots and rings."""
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
        rings = {piece for piece in endless(after) if piece in reached(after[piece], after)}
        return reached(knots, after) | reached(knots, before) | rings

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
        for start in self.pieces(road=True):
            for end, inside in self.ways_from(start):
                paths = nodes.setdefault(self.node(start[0], start[1] + 1), [])
                paths.append(Path(start=start, inside=inside, end=end))
                if len(paths) > MAX_LINKS:
                    raise self.too_large(start)
        return nodes

    def pieces_on(self, lane_id: int, start: float, end: float) -> list[Piece]:
        """Return the junction pieces that share some of a stretch of a lane, m."""
        row, index = self.where[lane_id]
        pieces = ((row, k, index) for k, inside in enumerate(self.rows[row].inside) if inside)
        spans = ((piece, *self.span(piece)) for piece in pieces)
        return [piece for piece, low, high in spans if min(high, end) - max(low, start) > -1e-6]

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
