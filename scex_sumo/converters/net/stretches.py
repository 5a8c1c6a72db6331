"""Stretches on which vehicles on two internal lanes are in each other's way, told to SUMO where it is blind.

SUMO looks for the point where two internal lanes cross. There is none where they only pass close by, or come
together without a common target; and one point is not enough where they run against each other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.elements import Connection, NetLane, Node
from scex_sumo.geometry.polylines import project_near, samples
from scex_sumo.roads.conflicts import CLEARANCE_M, STEP_M, lines_cross, opposed

# SUMO takes a stretch for real only if it begins or ends strictly within the lane.
INSET_M = 0.5


def stretches(node: Node) -> Iterator[tuple[Connection, Connection, tuple[float, float]]]:
    """Pairs of connections that SUMO must be told about, with the stretch of the first one, m."""
    links = node.connections
    sampled = {c.internal.name: samples(c.internal.shape, STEP_M) for c in links if c.link.foes}
    for a in links:
        for j in sorted(a.link.foes):
            b = links[j]
            if (a.to_edge, a.to_lane) == (b.to_edge, b.to_lane):
                continue  # SUMO knows how to merge
            span = _close(a.internal, b.internal, *sampled[a.internal.name])
            other = _close(b.internal, a.internal, *sampled[b.internal.name]) if span is not None else None
            if span is None or other is None:
                continue
            crossing = lines_cross(a.internal.shape, b.internal.shape)
            if not crossing or opposed(a.internal.shape, b.internal.shape, span, other):
                yield a, b, span


def _close(a: NetLane, b: NetLane, s: FloatArray, points: FloatArray) -> tuple[float, float] | None:
    """First and last position on a lane, sampled at arc lengths, within the clearance of another."""
    clearance = min(CLEARANCE_M, 0.45 * (a.width + b.width))
    near = np.flatnonzero(project_near(points, b.shape, clearance)[1] < clearance)
    if not len(near):
        return None
    inset = min(INSET_M, a.length / 4)
    start, end = max(float(s[near[0]]), inset), min(float(s[near[-1]]), a.length - inset)
    return (start, end) if end > start else None
