"""Cuts of lanes into roads and junctions, until SUMO can handle every junction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from scex_sumo.lanelet2sumo.topology.graph import Piece, Topology
from scex_sumo.lanelet2sumo.topology.rows import STUB_M, Row, Zone, build_rows, lay_zones
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

ROOM_M = 7.5  # a car of 5 m and SUMO's default gap of 2.5 m
NARROW_M = 4.0


def cut_lanes(
    lanes: Mapping[int, Lane], conflicts: Sequence[Conflict], walked: Sequence[Zone] = ()
) -> tuple[Topology, list[tuple[int, int]]]:
    """Cut lanes into roads and junctions, by conflicts, crosswalks (``walked``) and SUMO's needs.

    Returns the graph, and the permitted lane changes (from, to) that it cannot hold.
    """
    rows, lost = build_rows(lanes)
    closed = {i for row in lay_zones(rows, lanes, conflicts) if all(row.inside) for i in row.lanes}
    # Lanes without a stretch clear of other traffic: the edge for their changes would hide a conflict.
    inside = [(i, j) for i in sorted(closed) for j in (lanes[i].left, lanes[i].right) if j is not None]
    lost += [change for change in inside if change not in lost]
    lanes = {i: replace(x, left=None, right=None) if i in closed else x for i, x in lanes.items()}
    rows, _ = build_rows(lanes)
    zones: list[Conflict | Zone] = [*conflicts, *walked]
    rows = [  # lanes side by side need some road to change on
        _opened(row, 0) if len(row.lanes) > 1 and all(row.inside) else row
        for row in lay_zones(rows, lanes, zones)
    ]
    rows = _open_knots(rows, lanes)
    rows = _fill_gaps(Topology(rows, lanes, zones))
    rows = _split_loops(Topology(rows, lanes, zones))
    return Topology(rows, lanes, zones), lost


def _fill_gaps(topology: Topology) -> list[Row]:
    chains, node = Topology(topology.rows, topology.lanes), topology.node
    for _, r, k in sorted(_gaps(chains)):
        row = chains.rows[r]
        if row.size(k) > NARROW_M and node(r, k) != node(r, k + 1):
            continue
        if len(row.lanes) > 1 and row.inside.count(False) == 1:
            continue  # its only place for changing lanes
        chains.rows[r] = row.with_inside(k, True)
        pieces = {(r, k, index) for index in range(len(row.lanes))}
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


def _gaps(chains: Topology) -> Iterator[tuple[float, int, int]]:
    for r, row in enumerate(chains.rows):
        for k, inside in enumerate(row.inside):
            pieces = [(r, k, index) for index in range(len(row.lanes))]
            if inside or row.size(k) >= ROOM_M:
                continue
            sides = (side for piece in pieces for side in (chains.before(piece), chains.after(piece)))
            if all(any(map(chains.is_inside, side)) for side in sides):
                yield row.size(k), r, k


def _open_knots(rows: Sequence[Row], lanes: Mapping[int, Lane]) -> list[Row]:
    """Cut edges into junction pieces until SUMO can handle every junction.

    These are pieces where traffic merges and forks again, and double ways between the same two road pieces.
    """
    chains = Topology(rows, lanes)
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


def _knot(chains: Topology) -> tuple[int, int] | None:
    def rank(cut: tuple[int, int]) -> tuple[bool, float, int, int]:
        lanes = range(len(chains.rows[cut[0]].lanes))
        merging = any(len(chains.before((*cut, index))) > 1 for index in lanes)
        return merging, chains.rows[cut[0]].size(cut[1]), -cut[0], -cut[1]

    return max({piece[:2] for piece in chains.unsound(chains.pieces())}, key=rank, default=None)


def _double_way(chains: Topology) -> list[tuple[int, int]]:
    for start in chains.pieces(road=True):
        chains_between: dict[Piece, tuple[Piece, ...]] = {}
        for end, chain in chains.ways_from(start):
            other = chains_between.setdefault(end, chain)
            apart = [[p for p in a if p not in b] for a, b in ((chain, other), (other, chain))]
            longest = [max(p, key=lambda q: (chains.rows[q[0]].size(q[1]), q)) for p in apart if p]
            if longest:
                return sorted({piece[:2] for piece in longest})
    return []


def _opened(row: Row, piece: int) -> Row:
    start, end = row.cuts[piece], row.cuts[piece + 1]
    return row.with_road(piece, start + (end - start) * min(STUB_M / row.size(piece), 1 / 3))
