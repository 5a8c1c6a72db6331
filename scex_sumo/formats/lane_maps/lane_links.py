"""Successors and neighbours of lanes, as maps name them, and overlaps; each known to both sides.

Lanelet2 finds overlaps itself.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.file import Findings
from scex_sumo.road import Lane
from scex_sumo.roads.side import DEAD_ENDS, dead_ends

TOUCH_M = 0.1  # areas that overlap by less than twice this only touch
MIN_HEADROOM_M = 3.0  # bridges leave 4.5 m and more
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


def overlapping(lanes: Mapping[int, Lane], centres: Mapping[int, FloatArray]) -> dict[int, Lane]:
    """Return the lanes with ``conflicts`` set: vehicle lanes whose areas overlap.

    As in Lanelet2, lanes do not conflict if they follow one another, lie side by side in one direction, or
    lie on different levels.

    Args:
        centres: centreline by lane id, (P, 3) with heights or (P, 2).
    """
    ids = [i for i, lane in lanes.items() if lane.kind == "vehicle"]
    rings = [np.concatenate([lanes[i].right_bound, lanes[i].left_bound[::-1]]) for i in ids]
    areas = shapely.make_valid([shapely.Polygon(ring) for ring in rings])
    areas = shapely.buffer(areas, -TOUCH_M, quad_segs=16)
    # Without heights: low is inf, high is -inf.
    low = {i: line[:, 2:].min(initial=np.inf) for i, line in centres.items()}
    high = {i: line[:, 2:].max(initial=-np.inf) for i, line in centres.items()}
    overlaps: dict[int, set[int]] = {i: set() for i in ids}
    for i, j in shapely.STRtree(areas).query(areas, predicate="intersects").T.tolist():
        a, b = ids[i], ids[j]
        beside = (lanes[a].adjacent_left, lanes[a].adjacent_right, lanes[a].reverse_of)
        linked = b in (*beside, *lanes[a].successors, *lanes[a].predecessors) or a == lanes[b].reverse_of
        if a < b and not linked:
            level = max(high[a] - low[b], high[b] - low[a]) < MIN_HEADROOM_M
            if level or _on_one_level(centres[a], centres[b], shapely.intersection(areas[i], areas[j])):
                overlaps[a].add(b)
                overlaps[b].add(a)
    return {i: replace(lane, conflicts=tuple(sorted(overlaps.get(i, ())))) for i, lane in lanes.items()}


def _on_one_level(a: FloatArray, b: FloatArray, shared: shapely.Geometry) -> bool:
    if a.shape[1] < 3 or b.shape[1] < 3 or shared.is_empty:
        return True
    place = np.array(shared.centroid.coords[0])
    levels = [line[np.argmin(np.hypot(*(line[:, :2] - place).T)), 2] for line in (a, b)]
    return abs(float(levels[0] - levels[1])) < MIN_HEADROOM_M
