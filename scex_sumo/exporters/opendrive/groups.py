"""Lane groups: lanes side by side with shared borders, and cuts between groups."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import distances
from scex_sumo.road import Lane

_SHARED_M = 0.02  # else neighbours become two roads

Group: TypeAlias = tuple[int, ...]  # lane ids, leftmost first
Chain: TypeAlias = tuple[Group, ...]  # groups that follow one another, lane by lane


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


def borders(lanes: Mapping[int, Lane], group: Group) -> list[FloatArray]:
    """Return the left border of the leftmost lane, then each lane's right border, m."""
    return [lanes[group[0]].left_bound, *(lanes[i].right_bound for i in group)]


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
