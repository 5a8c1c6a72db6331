"""Gaps between conflicts: which of them stay edges, and which are left to the junction around them.

A vehicle that waits needs room: road pieces shorter than a car between two conflicts belong to the junction.
But SUMO keeps vehicles apart only if traffic that has come together runs over an edge before it parts
again: a junction piece must not have several ways in and several ways out at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias

from scex_sumo.converters.net.pieces.rows import STUB_M, Piece, Row
from scex_sumo.road import Lane

NodeOf: TypeAlias = Callable[[int, int], tuple[int, int]]  # row and cut to the junction there

ROOM_M = 7.5  # a car of 5 m and SUMO's default gap of 2.5 m
NARROW_M = 4.0


class Chains:
    """Piece after piece along the lanes; a row may be exchanged for one of the same lanes, cut otherwise.

    Attributes:
        rows: the rows.
        lanes: the lanes by id.
        where: (row, lane within the row) of each lane id.
    """

    def __init__(self, rows: Sequence[Row], lanes: Mapping[int, Lane]) -> None:
        self.rows = list(rows)
        self.lanes = lanes
        self.where = {i: (r, k) for r, row in enumerate(rows) for k, i in enumerate(row.lanes)}

    def is_inside(self, piece: Piece) -> bool:
        """Whether a piece lies in a junction."""
        return self.rows[piece[0]].inside[piece[1]]

    def after(self, piece: Piece) -> list[Piece]:
        """Pieces that follow."""
        row, k, at = piece
        if k + 1 < self.rows[row].pieces:
            return [(row, k + 1, at)]
        lanes = self.lanes[self.rows[row].lanes[at]].successors
        return [(self.where[i][0], 0, self.where[i][1]) for i in lanes if i in self.where]

    def before(self, piece: Piece) -> list[Piece]:
        """Pieces that precede."""
        row, k, at = piece
        if k:
            return [(row, k - 1, at)]
        lanes = self.lanes[self.rows[row].lanes[at]].predecessors
        found = [self.where[i] for i in lanes if i in self.where]
        return [(r, self.rows[r].pieces - 1, at) for r, at in found]

    def reach(self, piece: Piece, step: Callable[[Piece], list[Piece]]) -> tuple[set[Piece], set[Piece]]:
        """Junction pieces and the road pieces behind them that are reached from a piece through a junction.

        ``step`` is ``after`` or ``before``.
        """
        inside, road, stack = {piece}, set(), [piece]
        while stack:
            for other in step(stack.pop()):
                if not self.is_inside(other):
                    road.add(other)
                elif other not in inside:
                    inside.add(other)
                    stack.append(other)
        return inside, road

    def is_sound(self, piece: Piece) -> bool:
        """Whether SUMO can keep vehicles apart on every way through the junction that runs over a piece."""
        upstream, _ = self.reach(piece, self.before)
        downstream, _ = self.reach(piece, self.after)
        if len(upstream & downstream) > 1 or any(piece in self.after(p) for p in downstream):
            return False  # a ring within one junction
        return all(self._is_simple(p) for p in upstream | downstream)

    def _is_simple(self, piece: Piece) -> bool:
        return any(len(self.reach(piece, step)[1]) < 2 for step in (self.before, self.after))


def fill_gaps(rows: Sequence[Row], lanes: Mapping[int, Lane], node: NodeOf) -> list[Row]:
    """Rows with short road pieces between junction pieces left to the junction, shortest first, where sound.

    Args:
        rows: the rows.
        lanes: the lanes by id.
        node: the junction that a cut of a row belongs to, so far. Between two junctions a gap that gives
            most of a car room stays.
    """
    chains = Chains(rows, lanes)
    for _, r, k in sorted(_gaps(chains)):
        row = chains.rows[r]
        if row.size(k) > NARROW_M and node(r, k) != node(r, k + 1):
            continue
        if len(row.lanes) > 1 and row.inside.count(False) == 1:
            continue  # its only place for changing lanes
        chains.rows[r] = row.with_inside(k, True)
        if not all(chains.is_sound((r, k, at)) for at in range(len(row.lanes))):
            chains.rows[r] = row
    return chains.rows


def split_loops(rows: Sequence[Row], node: NodeOf) -> list[Row]:
    """Rows with edges halved that leave a junction and enter it again: netconvert refuses such edges."""
    result = []
    for r, row in enumerate(rows):
        halved = row
        for k in reversed(range(row.pieces)):
            if not row.inside[k] and node(r, k) == node(r, k + 1):
                halved = halved.with_road(k, (row.cuts[k] + row.cuts[k + 1]) / 2)
        result.append(halved)
    return result


def _gaps(chains: Chains) -> Iterator[tuple[float, int, int]]:
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


def open_knots(rows: Sequence[Row], lanes: Mapping[int, Lane]) -> list[Row]:
    """The rows with edges cut into junction pieces until every junction is one that SUMO can handle.

    Cut are: pieces where traffic comes together and parts again within one junction; and two ways through a
    junction between the same two road pieces, which SUMO could not tell apart.
    """
    chains = Chains(rows, lanes)
    for _ in range(sum(row.pieces for row in rows)):
        knot = _knot(chains)
        twins = [] if knot else _double_way(chains)
        if knot:
            chains.rows[knot[0]] = _opened(chains.rows[knot[0]], knot[1], STUB_M)
        elif not twins:
            break
        for r, k in twins:
            chains.rows[r] = chains.rows[r].with_inside(k, False)
    return chains.rows


def _knot(chains: Chains) -> tuple[int, int] | None:
    """The longest piece that an edge must be cut into, those first behind a merge."""
    found = []
    for r, row in enumerate(chains.rows):
        for k in range(row.pieces):
            pieces = [(r, k, at) for at in range(len(row.lanes))]
            if row.inside[k] and not all(chains.is_sound(piece) for piece in pieces):
                merging = any(len(chains.before(piece)) > 1 for piece in pieces)
                found.append((merging, row.size(k), -r, -k))
    if not found:
        return None
    _, _, r, k = max(found)
    return -r, -k


def _double_way(chains: Chains) -> list[tuple[int, int]]:
    """Two ways through a junction that begin and end on the same road pieces: the longest piece of each."""
    for r, row in enumerate(chains.rows):
        for k in range(row.pieces):
            for at in range(len(row.lanes)):
                ways: dict[Piece, tuple[Piece, ...]] = {}
                for end, way in [] if row.inside[k] else _ways_from(chains, (r, k, at)):
                    other = ways.setdefault(end, way)
                    if other != way:
                        apart = [[p for p in a if p not in b] for a, b in ((way, other), (other, way))]
                        longest = [
                            max(p, key=lambda q: (chains.rows[q[0]].size(q[1]), q)) for p in apart if p
                        ]
                        return sorted({piece[:2] for piece in longest})
    return []


def _ways_from(chains: Chains, start: Piece) -> Iterator[tuple[Piece, tuple[Piece, ...]]]:
    stack: list[tuple[Piece, ...]] = [(start,)]
    while stack:
        way = stack.pop()
        for piece in chains.after(way[-1]):
            if not chains.is_inside(piece):
                yield piece, way[1:]
            elif piece not in way:
                stack.append((*way, piece))


def _opened(row: Row, piece: int, size: float) -> Row:
    """Row with a short road piece at the beginning of a junction piece, behind where traffic has merged.

    Args:
        row: the row to cut.
        piece: which of its pieces, one inside a junction.
        size: wanted length, m; at most a third of the piece is taken.
    """
    start, end = row.cuts[piece], row.cuts[piece + 1]
    return row.with_road(piece, start + (end - start) * min(size / row.size(piece), 1 / 3))
