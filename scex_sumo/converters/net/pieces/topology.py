"""Topology of a SUMO net from rows of pieces: edges, nodes, and the paths through the nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

from scex_sumo.converters.net.pieces.gaps import Chains, fill_gaps, open_knots, split_loops
from scex_sumo.converters.net.pieces.rows import STUB_M, Piece, Row, Zone, build_rows, lay_zones
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

Cut: TypeAlias = tuple[int, int]  # row, cut of the row


@dataclass(frozen=True, kw_only=True)
class Path:
    """One way through a node: a SUMO connection.

    Attributes:
        start: the road piece it comes from.
        inside: the junction pieces it runs over, none where road follows road.
        end: the road piece it leads to.
    """

    start: Piece
    inside: tuple[Piece, ...]
    end: Piece

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """All pieces in driving order."""
        return (self.start, *self.inside, self.end)


class Topology:
    """The graph that a set of cut rows stands for.

    Attributes:
        rows: the rows.
        lanes: the lanes by id.
        where: (row, lane within the row) of each lane id.
    """

    def __init__(
        self, rows: Sequence[Row], lanes: Mapping[int, Lane], found: Sequence[Conflict | Zone]
    ) -> None:
        self.rows = rows
        self.lanes = lanes
        self._chains = Chains(rows, lanes)
        self.where = self._chains.where
        self._parent: dict[Cut, Cut] = {}
        self._join_cuts(found)

    @cached_property
    def paths(self) -> list[Path]:
        """Every path, ordered by start."""
        return list(self._find_paths())

    def lane_id(self, piece: Piece) -> int:
        """The lanelet a piece belongs to."""
        return self.rows[piece[0]].lanes[piece[2]]

    def is_inside(self, piece: Piece) -> bool:
        """Whether a piece lies in a junction."""
        return self.rows[piece[0]].inside[piece[1]]

    def node(self, row: int, cut: int) -> Cut:
        """The node that a cut of a row belongs to, named by its first cut."""
        root = (row, cut)
        while self._parent.get(root, root) != root:
            root = self._parent[root]
        return root

    def path_node(self, path: Path) -> Cut:
        """The node that a path crosses."""
        return self.node(path.start[0], path.start[1] + 1)

    def pieces_on(self, lane_id: int, start: float, end: float) -> list[Piece]:
        """Junction pieces of a lane that share some of a stretch of it, m."""
        row, at = self.where[lane_id]
        found = []
        for k, inside in enumerate(self.rows[row].inside):
            low, high = self.rows[row].span(k, at)
            if inside and min(high, end) - max(low, start) > -1e-6:
                found.append((row, k, at))
        return found

    def _unite(self, a: Cut, b: Cut) -> None:
        a, b = sorted((self.node(*a), self.node(*b)))
        self._parent[b] = a

    def _join_cuts(self, found: Sequence[Conflict | Zone]) -> None:
        for r, row in enumerate(self.rows):
            for k, inside in enumerate(row.inside):
                if inside:
                    self._unite((r, k), (r, k + 1))
            for i in row.lanes:
                for j in self.lanes[i].successors:
                    if j in self.where:
                        self._unite((r, row.pieces), (self.where[j][0], 0))
        for conflict in found:
            touched = [
                piece
                for lane, span in zip(conflict.lanes, conflict.spans, strict=True)
                for piece in self.pieces_on(lane, *span)
            ]
            for piece in touched[1:]:
                self._unite(touched[0][:2], piece[:2])

    def _find_paths(self) -> Iterator[Path]:
        for r, row in enumerate(self.rows):
            for k in range(row.pieces):
                for lane in range(len(row.lanes)):
                    if not row.inside[k]:
                        yield from self._paths_from((r, k, lane))

    def _paths_from(self, start: Piece) -> Iterator[Path]:
        stack: list[tuple[Piece, ...]] = [(piece,) for piece in reversed(self._chains.after(start))]
        while stack:
            way = stack.pop()
            if not self.is_inside(way[-1]):
                yield Path(start=start, inside=way[:-1], end=way[-1])
                continue
            for piece in reversed(self._chains.after(way[-1])):
                if piece not in way:  # a ring that lies wholly inside one junction
                    stack.append((*way, piece))


def cut_lanes(
    lanes: Mapping[int, Lane], found: Sequence[Conflict], walked: Sequence[Zone] = ()
) -> tuple[Topology, list[tuple[int, int]]]:
    """Lanes as rows, cut where their conflicts and SUMO's rules for junctions want it.

    Every step makes new rows; which junction a cut belongs to is found anew where a step asks for it.

    Args:
        lanes: by id.
        found: their conflicts.
        walked: where people walk across.

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
    rows = [_with_road_to_change_on(row) for row in lay_zones(rows, lanes, zones)]
    rows = open_knots(rows, lanes)
    rows = fill_gaps(rows, lanes, Topology(rows, lanes, zones).node)
    rows = split_loops(rows, Topology(rows, lanes, zones).node)
    return Topology(rows, lanes, zones), lost


def _with_road_to_change_on(row: Row) -> Row:
    """A row of several lanes that lies under a crosswalk whole, with a stub of road before it."""
    if len(row.lanes) == 1 or not all(row.inside):
        return row
    return row.with_road(0, min(STUB_M / row.size(0), 1 / 3) * row.cuts[1])
