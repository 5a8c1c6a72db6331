"""Road network of OpenDRIVE: groups of lanes side by side, roads, and the connecting roads of junctions.

Where lanes fork, the following road connects; where they merge, the road before. Such a chain is cut: a
connecting road lies between two roads outside of junctions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.reference import Chain, Group, borders
from scex_sumo.exporters.opendrive.ribbons import MAX_ERROR_M, Ribbon, RoadEnd, fitting_groups, ribbon_of
from scex_sumo.geometry.polylines import distances
from scex_sumo.road import Lane

_MAX_HEAD_M = 20.0  # of a connecting road cut from a chain

_SHARED_M = 0.02  # else neighbours become two roads


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """Place where chains end and others begin; ``links`` are the lanes (from, to)."""

    ends: tuple[Chain, ...]
    starts: tuple[Chain, ...]
    links: tuple[tuple[int, int], ...]

    @property
    def plain(self) -> bool:
        """Whether one chain follows another without forking or merging lanes."""
        before, after = ([link[k] for link in self.links] for k in (0, 1))
        single = len(set(before)) == len(before) and len(set(after)) == len(after)
        return len(self.ends) == len(self.starts) == 1 and single


def lane_groups(lanes: Mapping[int, Lane]) -> list[Group]:
    """Return groups of lanes side by side, by smallest lane id."""
    left_of: dict[int, int] = {}
    for i, lane in lanes.items():
        j = lane.adjacent_left if lane.adjacent_left is not None else lane.left
        if j is not None and j != i and j in lanes and i in (lanes[j].adjacent_right, lanes[j].right):
            other = lanes[j]
            if other.kind == lane.kind and _same_line(lane.left_bound, other.right_bound):
                left_of[i] = j
    right_of = {j: i for i, j in left_of.items()}
    left_of = {i: j for j, i in right_of.items()}
    groups = []
    for i in lanes:
        if i not in left_of:
            group = [i]
            while group[-1] in right_of:
                group.append(right_of[group[-1]])
            groups.append(tuple(group))
    return sorted(groups, key=min)


def chains_and_cuts(
    lanes: Mapping[int, Lane], groups: Sequence[Group], *, apart: Collection[Group] = ()
) -> tuple[list[Chain], list[Cut]]:
    """Return chains of groups that follow lane by lane, and the cuts between them.

    ``apart``: groups that stay chains of their own.
    """
    group_of = {i: group for group in groups for i in group}
    following: dict[Group, Group] = {}
    for ends, starts, links in _meetings(lanes, group_of):
        pairs = tuple(zip(ends[0], starts[0], strict=False))
        alone = len(ends) == len(starts) == 1 and len(ends[0]) == len(starts[0])
        free = alone and ends[0] != starts[0] and ends[0] not in apart and starts[0] not in apart
        if free and set(links) == set(pairs):
            following[ends[0]] = starts[0]
    chains = list(_joined(groups, following))
    first, last = {c[0]: c for c in chains}, {c[-1]: c for c in chains}
    cuts = [
        Cut(ends=tuple(last[g] for g in ends), starts=tuple(first[g] for g in starts), links=links)
        for ends, starts, links in _meetings(lanes, group_of)
        if ends[0] in last and starts[0] in first
    ]
    return chains, cuts


def _same_line(a: FloatArray, b: FloatArray) -> bool:
    if a.shape == b.shape and np.allclose(a, b, rtol=0, atol=_SHARED_M):
        return True
    return bool(max(distances(a, b).max(), distances(b, a).max()) < _SHARED_M)


def _joined(groups: Sequence[Group], following: dict[Group, Group]) -> Iterator[Chain]:
    preceded, seen = set(following.values()), set[Group]()
    for group in [*(g for g in groups if g not in preceded), *groups]:
        if group in seen:
            continue
        chain = [group]
        seen.add(group)
        while (next_ := following.get(chain[-1])) is not None and next_ not in seen:
            chain.append(next_)
            seen.add(next_)
        yield tuple(chain)


def _meetings(
    lanes: Mapping[int, Lane], group_of: Mapping[int, Group]
) -> list[tuple[list[Group], list[Group], tuple[tuple[int, int], ...]]]:
    links = [(i, j) for i in group_of for j in lanes[i].successors if j in group_of]
    met = DisjointSet((group, end) for group in group_of.values() for end in (True, False))
    for i, j in links:
        met.merge((group_of[i], True), (group_of[j], False))
    places: dict[tuple[Group, bool], list[tuple[int, int]]] = {}
    for i, j in links:
        places.setdefault(met[group_of[i], True], []).append((i, j))
    return [
        (_distinct(group_of[i] for i, _ in here), _distinct(group_of[j] for _, j in here), tuple(here))
        for here in places.values()
    ]


def _distinct(groups: Iterable[Group]) -> list[Group]:
    return list(dict.fromkeys(groups))


@dataclass(frozen=True, kw_only=True)
class RoadLink:
    """Predecessor or successor: the number of a road or junction.

    Attributes:
        lanes: linked lanes (own, other), by OpenDRIVE number; none for a junction.
    """

    road: int | None = None
    junction: int | None = None
    lanes: tuple[tuple[int, int], ...] = ()


@dataclass(kw_only=True, eq=False)
class Piece:
    """Road of OpenDRIVE."""

    number: int
    ribbon: Ribbon
    before: RoadLink | None = None
    after: RoadLink | None = None
    junction: int | None = None


@dataclass(kw_only=True, eq=False)
class _Parts:
    heads: dict[Chain, Piece] = field(default_factory=dict)
    rest: Piece | None = None
    tail: Piece | None = None

    @property
    def last(self) -> Piece:
        return self.tail or self.rest or next(iter(self.heads.values()))


def road_network(lanes: Mapping[int, Lane]) -> list[Piece]:
    """Return the linked roads of all lanes."""
    groups = [part for group in lane_groups(lanes) for part in fitting_groups(lanes, group)]
    chains, cuts = chains_and_cuts(lanes, groups)
    ribbons = {chain: ribbon_of(lanes, chain) for chain in chains}
    broken = [chain for chain in chains if len(chain) > 1 and ribbons[chain].error > MAX_ERROR_M]
    if broken:
        ribbons |= {(group,): ribbon_of(lanes, (group,)) for chain in broken for group in chain}
        chains, cuts = chains_and_cuts(lanes, groups, apart={g for chain in broken for g in chain})
    return _Network(chains, cuts, ribbons | _on_common_edges(lanes, cuts, ribbons)).pieces


def _on_common_edges(
    lanes: Mapping[int, Lane], cuts: Sequence[Cut], ribbons: Mapping[Chain, Ribbon]
) -> dict[Chain, Ribbon]:
    edges: dict[Chain, list[RoadEnd | None]] = {}
    for cut in cuts:
        sides = [(chain, True) for chain in cut.ends] + [(chain, False) for chain in cut.starts]
        widest, end = max(sides, key=lambda side: len(_edge_group(*side)))
        if len(_edge_group(widest, end)) < 2:
            continue
        edge = ribbons[widest].edge(end=end)
        for chain, end in sides:
            if edge.fits(borders(lanes, _edge_group(chain, end)), end=end):
                edges.setdefault(chain, [None, None])[end] = edge
    moved = {chain: ribbon_of(lanes, chain, (ends[0], ends[1])) for chain, ends in edges.items()}
    return {chain: ribbon for chain, ribbon in moved.items() if ribbon.error < MAX_ERROR_M}


def _edge_group(chain: Chain, end: bool) -> Group:
    return chain[-1 if end else 0]


class _Network:
    def __init__(self, chains: Sequence[Chain], cuts: Sequence[Cut], ribbons: Mapping[Chain, Ribbon]) -> None:
        self.pieces: list[Piece] = []
        self._ribbons = ribbons
        self._entry = {chain: cut for cut in cuts for chain in cut.starts}
        self._exit = {chain: cut for cut in cuts for chain in cut.ends}
        self._parts = {chain: self._divided(chain) for chain in chains}
        self._joined: dict[int, int] = {}
        numbers = {id(cut): k for k, cut in enumerate(cuts)}
        for cut in cuts:
            if cut.plain:
                self._link_roads(cut)
            else:
                self._link_junction(cut, numbers[id(cut)])
        for chain, parts in self._parts.items():
            self._link_inside(chain, parts, numbers)
        self._settle_junctions()

    def _divided(self, chain: Chain) -> _Parts:
        entry, exit_, ribbon = self._entry.get(chain), self._exit.get(chain), self._ribbons[chain]
        forks = entry is not None and not entry.plain and _forks(entry)
        merges = exit_ is not None and not exit_.plain and not _forks(exit_)
        head = min(_MAX_HEAD_M / max(ribbon.length, 1e-9), 0.5 if not merges else 1 / 3)
        parts = _Parts()
        if forks and merges and entry is not None and len(entry.ends) == 1:
            parts.heads[entry.ends[0]] = self._piece(ribbon)
            return parts
        shares = [head] * forks + [1 - head] * merges
        pieces = ribbon.split(*shares)
        if forks and entry is not None:
            parts.heads = {
                end: self._piece(pieces[0]) for end in entry.ends if _lane_pairs(entry, end, chain)
            }
            pieces = pieces[1:]
        parts.rest = self._piece(pieces[0])
        if merges:
            parts.tail = self._piece(pieces[1])
        return parts

    def _piece(self, ribbon: Ribbon) -> Piece:
        self.pieces.append(Piece(number=len(self.pieces) + 1, ribbon=ribbon))
        return self.pieces[-1]

    def _link_roads(self, cut: Cut) -> None:
        before, after = self._parts[cut.ends[0]].last, self._parts[cut.starts[0]].rest
        assert after is not None
        _join(before, after, _lane_pairs(cut, cut.ends[0], cut.starts[0]))

    def _link_junction(self, cut: Cut, junction: int) -> None:
        for start in cut.starts:
            for end in cut.ends:
                pairs = _lane_pairs(cut, end, start)
                if not pairs:
                    continue
                if _forks(cut):
                    before, after = self._parts[end].last, self._parts[start].heads[end]
                    connecting = after
                else:
                    before = connecting = self._parts[end].last
                    rest = self._parts[start].rest
                    assert rest is not None
                    after = rest
                _join(before, after, pairs)
                self._connect(connecting, junction)
                if connecting is after:
                    before.after = RoadLink(junction=junction)
                else:
                    after.before = RoadLink(junction=junction)

    def _connect(self, piece: Piece, junction: int) -> None:
        if piece.junction is not None:
            self._joined[self._root(junction)] = self._root(piece.junction)
        piece.junction = junction

    def _root(self, junction: int) -> int:
        while self._joined.get(junction, junction) != junction:
            junction = self._joined[junction]
        return junction

    def _link_inside(self, chain: Chain, parts: _Parts, numbers: Mapping[int, int]) -> None:
        if parts.rest is None:
            return
        pairs = tuple((-k - 1, -k - 1) for k in range(len(chain[0])))
        for head in parts.heads.values():
            _join(head, parts.rest, pairs)
            parts.rest.before = RoadLink(junction=numbers[id(self._entry[chain])])
        if parts.tail is not None:
            _join(parts.rest, parts.tail, pairs)
            parts.rest.after = RoadLink(junction=numbers[id(self._exit[chain])])

    def _settle_junctions(self) -> None:
        base = len(self.pieces) + 1
        for piece in self.pieces:
            if piece.junction is not None:
                piece.junction = base + self._root(piece.junction)
            for name in ("before", "after"):
                link = getattr(piece, name)
                if link is not None and link.junction is not None:
                    setattr(piece, name, replace(link, junction=base + self._root(link.junction)))


def _forks(cut: Cut) -> bool:
    return len(cut.ends) == 1 or len(cut.starts) > 1


def _lane_pairs(cut: Cut, end: Chain, start: Chain) -> tuple[tuple[int, int], ...]:
    before, after = _lane_numbers(end[-1]), _lane_numbers(start[0])
    return tuple((before[i], after[j]) for i, j in cut.links if i in before and j in after)


def _lane_numbers(group: Group) -> dict[int, int]:
    return {lane: -k - 1 for k, lane in enumerate(group)}


def _join(before: Piece, after: Piece, pairs: tuple[tuple[int, int], ...]) -> None:
    before.after = RoadLink(road=after.number, lanes=pairs)
    after.before = RoadLink(road=before.number, lanes=tuple((b, a) for a, b in pairs))


def connections(pieces: Sequence[Piece]) -> Iterator[tuple[int, Piece, Piece]]:
    """Yield each junction with an incoming and a connecting road."""
    by_number = {piece.number: piece for piece in pieces}
    for piece in pieces:
        if piece.junction is not None and piece.before is not None and piece.before.road is not None:
            yield piece.junction, by_number[piece.before.road], piece
