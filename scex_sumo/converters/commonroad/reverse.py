"""Second driving direction of lanelets that cars drive both ways."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.road import Lane

JOINT_M = 0.1  # both bounds of one lane end this near to where those of the next one begin


def with_reverse(lanes: Mapping[int, Lane], both_ways: Iterable[int]) -> dict[int, Lane]:
    """The same lanes, and one more against each that cars drive both ways.

    A lane against another follows what begins where the other began: the other direction of its predecessor,
    or a lane that leads away from there. Lanes are not changed from or to it.

    Args:
        lanes: connected.
        both_ways: ids of vehicle lanes that cars drive both ways.
    """
    result = dict(lanes)
    turned: dict[int, int] = {}
    for i in sorted(both_ways):
        lane = lanes[i]
        turned[i] = max(result) + 1
        result[turned[i]] = replace(
            lane,
            lane_id=turned[i],
            centreline=lane.centreline[::-1],
            left_bound=lane.right_bound[::-1],
            right_bound=lane.left_bound[::-1],
            successors=(),
            predecessors=(),
            left=None,
            right=None,
            adjacent_left=None,
            adjacent_right=None,
            reverse_of=i,
        )
    pairs = {(turned[j], turned[i]) for i in turned for j in lanes[i].successors if j in turned}
    pairs |= _joined(result, set(turned.values()))
    for a, b in sorted(pairs):
        result[a] = replace(result[a], successors=tuple(sorted({*result[a].successors, b})))
        result[b] = replace(result[b], predecessors=tuple(sorted({*result[b].predecessors, a})))
    return result


def _joined(lanes: Mapping[int, Lane], turned: set[int]) -> set[tuple[int, int]]:
    """Pairs (lane, lane that begins where it ends), one of them a second direction, of different lanelets."""
    driven = [lane for lane in lanes.values() if lane.kind == "vehicle"]
    if not turned:
        return set()
    starts, ends = _ends(driven, 0), _ends(driven, -1)
    near = np.abs(ends[:, None] - starts[None]).max(axis=2) < JOINT_M
    found = ((driven[k], driven[m]) for k, m in np.argwhere(near))
    return {
        (a.lane_id, b.lane_id)
        for a, b in found
        if {a.lane_id, b.lane_id} & turned and b.lane_id != a.reverse_of and a.lane_id != b.reverse_of
    }


def _ends(lanes: list[Lane], index: int) -> FloatArray:
    """(L, 4) first or last points of the left and the right bound."""
    return np.array([[*lane.left_bound[index], *lane.right_bound[index]] for lane in lanes])
