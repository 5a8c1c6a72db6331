"""Rows of lanes side by side, cut into pieces of roads and of junctions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Lane
from scex_sumo.roads.conflicts import Conflict

STUB_M = 2.0  # longest road piece cut off a junction piece where a lane begins or ends inside a conflict
SHORTEST_M = 0.1  # edge that SUMO takes
SNAP_M = 0.3  # road pieces shorter than this are left to the junction piece beside them


class Zone(NamedTuple):
    """Stretches of lanes that must lie in one junction; ``spans``: arc lengths on each of them, m."""

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
        cuts = (*self.cuts[: piece + 1], cut, *self.cuts[piece + 1 :])
        return replace(self, cuts=cuts, inside=(*self.inside[:piece], False, *self.inside[piece:]))


def build_rows(lanes: Mapping[int, Lane]) -> tuple[list[Row], list[tuple[int, int]]]:
    """Group lanes by permitted lane changes.

    Returns the rows, by smallest lane id, and the changes (from, to) for which a lane has another neighbour.
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


def lay_zones(
    rows: Sequence[Row], lanes: Mapping[int, Lane], conflicts: Sequence[Conflict | Zone]
) -> list[Row]:
    """Cut rows at conflicts; lanes that begin or end inside a conflict keep a stub of road."""
    spans: dict[int, list[tuple[float, float]]] = {}
    for conflict in conflicts:
        for lane, span in zip(conflict.lanes, conflict.spans, strict=True):
            spans.setdefault(lane, []).append(span)
    result = []
    for row in rows:
        sizes = zip(row.lanes, row.lengths, strict=True)
        zones = [(start / size, end / size) for lane, size in sizes for start, end in spans.get(lane, ())]
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
    snapped = ((low if a < low + gap else a, high if b > high - gap else b) for a, b in zones)
    return merged([(start, end) for start, end in snapped if end - start >= 1e-9], gap)


def merged(spans: Iterable[tuple[float, float]], gap: float) -> list[tuple[float, float]]:
    """Return disjoint spans, ascending; those that are at most a gap apart become one."""
    result: list[tuple[float, float]] = []
    for start, end in sorted(spans):
        if result and start <= result[-1][1] + gap:
            result[-1] = (result[-1][0], max(end, result[-1][1]))
        else:
            result.append((start, end))
    return result
