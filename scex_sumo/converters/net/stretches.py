"""Stretches on which vehicles on two internal lanes are in each other's way, told to SUMO where it is blind.

SUMO looks for the point where two internal lanes cross. There is none where they only pass close by, or come
together without a common target; and one point is not enough where they run against each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from scex_sumo.converters.net.elements import Connection, NetLane, Node
from scex_sumo.roads.conflicts import CLEARANCE_M, SampledLine, lines_cross, opposed

# SUMO takes a stretch for real only if it begins or ends strictly within the lane.
INSET_M = 0.5

_Span: TypeAlias = tuple[float, float]  # m along an internal lane


def stretches(node: Node) -> Iterator[tuple[Connection, Connection, _Span]]:
    """Pairs of connections that SUMO must be told about, with the stretch of the first one, m."""
    links = node.connections
    sampled = {i: SampledLine.of(c.internal.shape) for i, c in enumerate(links) if c.link.foes}
    spans: dict[tuple[int, int], _Span] = {}
    for i in sampled:
        for j in sorted(links[i].link.foes):
            if i < j:
                both = _unseen(links[i], links[j], sampled[i], sampled[j])
                spans |= zip(((i, j), (j, i)), both, strict=True) if both else ()
            if (i, j) in spans:
                yield links[i], links[j], spans[i, j]


def _unseen(a: Connection, b: Connection, on_a: SampledLine, on_b: SampledLine) -> tuple[_Span, _Span] | None:
    """Where two foes are in each other's way, on either one, unless SUMO finds that by itself."""
    if (a.to_edge, a.to_lane) == (b.to_edge, b.to_lane):
        return None  # SUMO knows how to merge
    span = _close(a.internal, b.internal, on_a, on_b)
    other = _close(b.internal, a.internal, on_b, on_a) if span is not None else None
    if span is None or other is None:
        return None
    crossing = lines_cross(a.internal.shape, b.internal.shape)
    told = not crossing or opposed(a.internal.shape, b.internal.shape, span, other)
    return (span, other) if told else None


def _close(lane: NetLane, other: NetLane, sampled: SampledLine, beside: SampledLine) -> _Span | None:
    """First and last position on a lane within the clearance of another, m."""
    clearance = min(CLEARANCE_M, 0.45 * (lane.width + other.width))
    near = np.flatnonzero(sampled.near(beside, clearance))
    if not len(near):
        return None
    inset = min(INSET_M, lane.length / 4)
    start, end = max(float(sampled.s[near[0]]), inset), min(float(sampled.s[near[-1]]), lane.length - inset)
    return (start, end) if end > start else None
