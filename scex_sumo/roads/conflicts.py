"""Conflicts of lanes: where cars on two lanes would touch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.crossings import Hits, intersect
from scex_sumo.geometry.polylines import along, arc_lengths, length_of, project, samples
from scex_sumo.road import Lane

CLEARANCE_M = 2.4  # of centrelines; a wide car and a car do not pass each other on less
STEP_M = 0.25
SLACK_M = 1e-3  # of boxes, against rounding
END_M = 0.1  # nearer to an end point lines do not cross
LineSamples: TypeAlias = tuple[FloatArray, FloatArray]
"""Places every `STEP_M` on a polyline, or nearer: arc lengths (N,) and points (N, 2), m."""


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """One stretch on which two lanes are in each other's way."""

    kind: str  # ``cross``, ``merge`` or ``diverge``
    lanes: tuple[int, int]
    spans: tuple[tuple[float, float], tuple[float, float]]  # arc length (start, end) on each, m


def conflicts(lanes: Mapping[int, Lane], *, border_forks: bool = False) -> list[Conflict]:
    """Return all conflicts between lanes, ordered by lane ids.

    ``border_forks``: include lanes that diverge at the map's border; who inserts a vehicle must check both.
    """
    pairs = {(min(i, j), max(i, j)) for i, lane in lanes.items() for j in lane.conflicts if j in lanes}
    pairs -= {(i, j) for i, j in pairs if i == j}
    between: list[Conflict] = []
    sampled = {i: samples(lanes[i].centreline, STEP_M) for i in {i for pair in pairs for i in pair}}
    for i, j in sorted(pairs):
        if _neighbours(lanes[i], lanes[j]) or j in lanes[i].successors or i in lanes[j].successors:
            continue
        between += _stretches(lanes[i], lanes[j], sampled[i], sampled[j])
    border = {i for i, lane in lanes.items() if not lane.predecessors and not border_forks}
    return [c for c in _kin(lanes, between) if not (c.kind == "diverge" and border.issuperset(c.lanes))]


def _kin(lanes: Mapping[int, Lane], pairs: list[Conflict]) -> list[Conflict]:
    """Recognise forks and merges that run over several short lanes.

    Two lanes that overlap from their starts without crossing continue a fork if their predecessors are one
    lane or diverge; merges in the same way.
    """
    changed = True
    while changed:
        changed = False
        forks = {c.lanes for c in pairs if c.kind == "diverge"}
        merges = {c.lanes for c in pairs if c.kind == "merge"}
        for k, c in enumerate(pairs):
            if c.kind != "cross":
                continue
            a, b = (lanes[i] for i in c.lanes)
            rests = [length_of(x.centreline) - s[1] for x, s in zip((a, b), c.spans, strict=True)]
            if max(s[0] for s in c.spans) < 2 * STEP_M and _related(a.predecessors, b.predecessors, forks):
                kind = "diverge"
            elif max(rests) < 2 * STEP_M and _related(a.successors, b.successors, merges):
                kind = "merge"
            else:
                continue
            if not lines_cross(a.centreline, b.centreline):
                pairs[k] = replace(c, kind=kind)
                changed = True
    return pairs


def _related(a: tuple[int, ...], b: tuple[int, ...], pairs: set[tuple[int, int]]) -> bool:
    return any(i == j or (min(i, j), max(i, j)) in pairs for i in a for j in b)


def lines_cross(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two polylines cross, except at their end points."""
    hits, i, _ = crossings_of(a, b)
    points = a[i] + hits.first[:, None] * (a[i + 1] - a[i])
    ends = np.array([a[0], a[-1], b[0], b[-1]])
    return bool((np.hypot(*(points[:, None] - ends).transpose(2, 0, 1)) > END_M).all(axis=1).any())


def crossings_of(a: FloatArray, b: FloatArray) -> tuple[Hits, IntArray, IntArray]:
    """Return the crossing points of two polylines, and the segments of both on which they are."""
    low, high = np.maximum(a.min(axis=0), b.min(axis=0)), np.minimum(a.max(axis=0), b.max(axis=0))
    i, j = (_segments_in(line, low - SLACK_M, high + SLACK_M) for line in (a, b))
    i, j = np.repeat(i, len(j)), np.tile(j, len(i))
    hits = intersect((*a[i].T, *(a[i + 1] - a[i]).T), (*b[j].T, *(b[j + 1] - b[j]).T))
    return hits, i[hits.which], j[hits.which]


def _segments_in(line: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    start, end = line[:-1], line[1:]
    return np.flatnonzero(((np.maximum(start, end) >= low) & (np.minimum(start, end) <= high)).all(axis=1))


def _neighbours(a: Lane, b: Lane) -> bool:
    return b.lane_id in (a.left, a.right, a.adjacent_left, a.adjacent_right)


def _stretches(a: Lane, b: Lane, on_a: LineSamples, on_b: LineSamples) -> list[Conflict]:
    clearance = min(CLEARANCE_M, 0.45 * (a.width_m + b.width_m))
    (s, points), (t, others) = on_a, on_b
    foot_b, gap_a = project_near(points, b.centreline, clearance)
    if not (gap_a < clearance).any():
        return []
    close_b = project_near(others, a.centreline, clearance)[1] < clearance
    pairs = []
    for first, last in runs(gap_a < clearance):
        there = foot_b[first : last + 1]
        span_b = _run_around(t, close_b, float(there.min()), float(there.max()))
        span_a = (float(s[first]), float(s[last]))
        kind = _kind(a, b, span_a, span_b, gap_a[first : last + 1])
        pairs.append(Conflict(kind=kind, lanes=(a.lane_id, b.lane_id), spans=(span_a, span_b)))
    return pairs


def project_near(points: FloatArray, line: FloatArray, reach_m: float) -> tuple[FloatArray, FloatArray]:
    """Project points onto a polyline like `project`; distances above ``reach_m`` may be infinite."""
    arc, gap = np.zeros(len(points)), np.full(len(points), np.inf)
    low, high = line.min(axis=0) - reach_m, line.max(axis=0) + reach_m
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    if len(near):
        low, high = points[near].min(axis=0) - reach_m, points[near].max(axis=0) + reach_m
        beside = (np.maximum(line[:-1], line[1:]) >= low) & (np.minimum(line[:-1], line[1:]) <= high)
        segments = np.flatnonzero(beside.all(axis=1))
        if len(segments):
            piece = slice(int(segments[0]), int(segments[-1]) + 2)
            arc[near], gap[near] = project(points[near], line[piece], arc_lengths(line)[piece])
    return arc, gap


def close_span(on_line: LineSamples, other: FloatArray, clearance_m: float) -> tuple[float, float] | None:
    """Return the first and last arc length of a line that is near another one, m; None if none is."""
    s, points = on_line
    near = np.flatnonzero(project_near(points, other, clearance_m)[1] < clearance_m)
    return (float(s[near[0]]), float(s[near[-1]])) if len(near) else None


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _run_around(s: FloatArray, close: BoolArray, low: float, high: float) -> tuple[float, float]:
    for first, last in runs(close):
        if s[last] >= low - STEP_M and s[first] <= high + STEP_M:
            low, high = min(low, float(s[first])), max(high, float(s[last]))
    return low, high


def _kind(a: Lane, b: Lane, span_a: tuple[float, float], span_b: tuple[float, float], gap: FloatArray) -> str:
    if opposed(a.centreline, b.centreline, span_a, span_b):
        return "cross"
    ends = [length_of(a.centreline) - span_a[1], length_of(b.centreline) - span_b[1]]
    starts = [span_a[0], span_b[0]]
    at_start, at_end = max(starts) < 2 * STEP_M, max(ends) < 2 * STEP_M
    if at_end and set(a.successors) & set(b.successors):
        return "merge"
    if at_start and set(a.predecessors) & set(b.predecessors):
        return "diverge"
    # In a longer chain the lanes are closest at the end where they meet its rest.
    low = float(gap.min()) + 0.1
    at_start, at_end = min(starts) < 2 * STEP_M, min(ends) < 2 * STEP_M
    if at_start and gap[0] <= low and not (at_end and gap[-1] < gap[0]):
        return "diverge"
    if at_end and gap[-1] <= low:
        return "merge"
    return "cross"


def opposed(a: FloatArray, b: FloatArray, span_a: tuple[float, float], span_b: tuple[float, float]) -> bool:
    """Return whether two polylines run against each other (over 120 degrees) along a stretch of each."""
    da, db = (np.diff(along(line, np.array(span)), axis=0)[0] for line, span in ((a, span_a), (b, span_b)))
    size = math.hypot(*da) * math.hypot(*db)
    return size > 0 and float(da @ db) / size < -0.5
