"""Road network of OpenDRIVE: groups of lanes side by side, roads, and the connecting roads of junctions.

Where lanes fork, the following road connects; where they merge, the road before. Such a group is cut: a
connecting road lies between two roads outside of junctions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.reference import Group, borders
from scex_sumo.exporters.opendrive.ribbons import MAX_ERROR_M, Ribbon, RoadEnd, fitting_groups, ribbon_of
from scex_sumo.geometry.polylines import distances
from scex_sumo.road import Lane

_MAX_HEAD_M = 20.0  # of a connecting road cut from a group

_SHARED_M = 0.02  # else neighbours become two roads


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """Place where groups end and others begin; ``links`` are the lanes (from, to)."""

    ends: tuple[Group, ...]
    starts: tuple[Group, ...]
    links: tuple[tuple[int, int], ...]

    @property
    def plain(self) -> bool:
        """Whether one group follows another without forking or merging lanes."""
        before, after = ([link[k] for link in self.links] for k in (0, 1))
        single = len(set(before)) == len(before) and len(set(after)) == len(after)
        return len(self.ends) == len(self.starts) == 1 and single


def lane_groups(lanes: Mapping[int, Lane]) -> list[Group]:
    """Return groups of lanes side by side, by smallest lane id."""
    right_of: dict[int, int] = {}
    for i, lane in lanes.items():
        j = lane.adjacent_left if lane.adjacent_left is not None else lane.left
        if j is not None and j != i and j in lanes and i in (lanes[j].adjacent_right, lanes[j].right):
            other = lanes[j]
            if other.kind == lane.kind and _same_line(lane.left_bound, other.right_bound):
                right_of[j] = i
    groups, right = [], set(right_of.values())
    for i in lanes:
        if i not in right:
            group = [i]
            while group[-1] in right_of:
                group.append(right_of[group[-1]])
            groups.append(tuple(group))
    return sorted(groups, key=min)


def _cuts(lanes: Mapping[int, Lane], groups: Sequence[Group]) -> list[Cut]:
    group_of = {i: group for group in groups for i in group}
    links = [(i, j) for i in group_of for j in lanes[i].successors if j in group_of]
    met = DisjointSet((group, end) for group in groups for end in (True, False))
    for i, j in links:
        met.merge((group_of[i], True), (group_of[j], False))
    places: dict[tuple[Group, bool], list[tuple[int, int]]] = {}
    for i, j in links:
        places.setdefault(met[group_of[i], True], []).append((i, j))
    return [
        Cut(
            ends=tuple(dict.fromkeys(group_of[i] for i, _ in here)),
            starts=tuple(dict.fromkeys(group_of[j] for _, j in here)),
            links=tuple(here),
        )
        for here in places.values()
    ]


def _same_line(a: FloatArray, b: FloatArray) -> bool:
    if a.shape == b.shape and np.allclose(a, b, rtol=0, atol=_SHARED_M):
        return True
    return bool(max(distances(a, b).max(), distances(b, a).max()) < _SHARED_M)


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
    heads: dict[Group, Piece] = field(default_factory=dict)
    rest: Piece | None = None
    tail: Piece | None = None

    @property
    def last(self) -> Piece:
        return self.tail or self.rest or next(iter(self.heads.values()))


def road_network(lanes: Mapping[int, Lane]) -> list[Piece]:
    """Return the linked roads of all lanes."""
    groups = [fitting for group in lane_groups(lanes) for fitting in fitting_groups(lanes, group)]
    cuts = _cuts(lanes, groups)
    ribbons = {group: ribbon_of(lanes, group) for group in groups}
    return _Network(groups, cuts, ribbons | _on_common_edges(lanes, cuts, ribbons)).pieces


def _on_common_edges(
    lanes: Mapping[int, Lane], cuts: Sequence[Cut], ribbons: Mapping[Group, Ribbon]
) -> dict[Group, Ribbon]:
    edges: dict[Group, list[RoadEnd | None]] = {}
    for cut in cuts:
        sides = [(group, True) for group in cut.ends] + [(group, False) for group in cut.starts]
        widest, end = max(sides, key=lambda side: len(side[0]))
        if len(widest) < 2:
            continue
        edge = ribbons[widest].edge(end=end)
        for group, end in sides:
            if edge.fits(borders(lanes, group), end=end):
                edges.setdefault(group, [None, None])[end] = edge
    moved = {group: ribbon_of(lanes, group, (ends[0], ends[1])) for group, ends in edges.items()}
    return {group: ribbon for group, ribbon in moved.items() if ribbon.error < MAX_ERROR_M}


class _Network:
    def __init__(self, groups: Sequence[Group], cuts: Sequence[Cut], ribbons: Mapping[Group, Ribbon]) -> None:
        self.pieces: list[Piece] = []
        self._ribbons = ribbons
        self._entry = {group: cut for cut in cuts for group in cut.starts}
        self._exit = {group: cut for cut in cuts for group in cut.ends}
        self._parts = {group: self._divided(group) for group in groups}
        numbers = {cut: k for k, cut in enumerate(cuts)}
        self._junctions = DisjointSet(numbers.values())
        for cut in cuts:
            if cut.plain:
                self._link_roads(cut)
            else:
                self._link_junction(cut, numbers[cut])
        for group, parts in self._parts.items():
            self._link_inside(group, parts, numbers)
        self._settle_junctions()

    def _divided(self, group: Group) -> _Parts:
        entry, exit_, ribbon = self._entry.get(group), self._exit.get(group), self._ribbons[group]
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
                end: self._piece(pieces[0]) for end in entry.ends if _lane_pairs(entry, end, group)
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
            self._junctions.merge(junction, piece.junction)
        piece.junction = junction

    def _link_inside(self, group: Group, parts: _Parts, numbers: Mapping[Cut, int]) -> None:
        if parts.rest is None:
            return
        pairs = tuple((-k - 1, -k - 1) for k in range(len(group)))
        for head in parts.heads.values():
            _join(head, parts.rest, pairs)
            parts.rest.before = RoadLink(junction=numbers[self._entry[group]])
        if parts.tail is not None:
            _join(parts.rest, parts.tail, pairs)
            parts.rest.after = RoadLink(junction=numbers[self._exit[group]])

    def _settle_junctions(self) -> None:
        base = len(self.pieces) + 1
        for piece in self.pieces:
            if piece.junction is not None:
                piece.junction = base + self._junctions[piece.junction]
            for name in ("before", "after"):
                link = getattr(piece, name)
                if link is not None and link.junction is not None:
                    setattr(piece, name, replace(link, junction=base + self._junctions[link.junction]))


def _forks(cut: Cut) -> bool:
    return len(cut.ends) == 1 or len(cut.starts) > 1


def _lane_pairs(cut: Cut, end: Group, start: Group) -> tuple[tuple[int, int], ...]:
    before, after = _lane_numbers(end), _lane_numbers(start)
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
