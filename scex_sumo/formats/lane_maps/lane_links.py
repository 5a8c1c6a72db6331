"""Successors and neighbours of lanes, as maps name them, each known to both sides."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from scex_sumo.converters.lanelet.file import Findings
from scex_sumo.road import Lane
from scex_sumo.roads.side import DEAD_ENDS, dead_ends

GAP_M = 1.0  # a successor that begins farther away than this gets a note


Ends: TypeAlias = Mapping[int, Collection[int]]
Sides: TypeAlias = Mapping[int, int | None]


def connected(
    findings: Findings,
    lanes: Mapping[int, Lane],
    ends: tuple[Ends, Ends],
    sides: tuple[Sides, Sides],
    may_change: Callable[[int, int, bool], bool],
) -> dict[int, Lane]:
    """Add successors, predecessors and neighbours to vehicle lanes, each known to both sides.

    Args:
        ends: ids after and before each lane, as a map names them; those of no vehicle lane are ignored.
        sides: id on the left and on the right of each lane.
        may_change: ``may_change(left, right, leftwards)``: whether a change between two lanes is allowed.
    """
    driven = {i for i, lane in lanes.items() if lane.kind == "vehicle"}
    pairs = _successors(findings, ends, lanes, driven)
    left_of = _left_neighbours(findings, sides, driven)
    right_of = {j: i for i, j in left_of.items()}
    after: dict[int, list[int]] = {i: [] for i in lanes}
    before: dict[int, list[int]] = {i: [] for i in lanes}
    for a, b in sorted(pairs):
        after[a].append(b)
        before[b].append(a)
    result = {}
    for i, lane in lanes.items():
        left, right = left_of.get(i), right_of.get(i)
        result[i] = replace(
            lane,
            successors=tuple(after[i]),
            predecessors=tuple(before[i]),
            adjacent_left=left,
            adjacent_right=right,
            left=left if left and may_change(left, i, True) else None,
            right=right if right and may_change(i, right, False) else None,
        )
    findings.note(DEAD_ENDS, *dead_ends(result))
    return result


def _successors(
    findings: Findings, ends: tuple[Ends, Ends], lanes: Mapping[int, Lane], driven: set[int]
) -> set[tuple[int, int]]:
    ahead = {(i, j) for i in driven for j in driven.intersection(ends[0][i])}
    behind = {(j, i) for i in driven for j in driven.intersection(ends[1][i])}
    for i, j in ahead ^ behind:
        findings.note("successors that only one of the two lanelets knows, kept", f"{i}-{j}")
    for i, j in ahead | behind:
        if np.hypot(*(lanes[i].centreline[-1] - lanes[j].centreline[0])) > GAP_M:
            findings.note(f"successors that begin more than {GAP_M:g} m from the end", f"{i}-{j}")
    return ahead | behind


def _left_neighbours(findings: Findings, sides: tuple[Sides, Sides], driven: set[int]) -> dict[int, int]:
    beside_it = {(i, j) for i in driven if (j := sides[0][i]) in driven and j is not None}
    other = {(i, j) for j in driven if (i := sides[1][j]) in driven and i is not None}
    for i, j in beside_it ^ other:
        findings.note("neighbours that only one of the two lanelets knows, left out", f"{i}-{j}")
    left_of = dict(sorted(beside_it & other))
    for i in [i for i in left_of if _in_ring(left_of, i)]:
        findings.note("neighbours in a ring, left out", i)
        del left_of[i]
    return left_of


def _in_ring(left_of: Mapping[int, int], start: int) -> bool:
    lane: int | None = left_of.get(start)
    for _ in left_of:
        if lane is None or lane == start:
            break
        lane = left_of.get(lane)
    return lane == start
