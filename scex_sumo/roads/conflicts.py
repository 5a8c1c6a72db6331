"""Conflicts: where two lanes come so close that cars on them would touch, and in which way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import along, length_of, project_near, samples
from scex_sumo.road import Lane

CLEARANCE_M = 2.4  # centreline distance under which a wide car and a car do not pass each other
STEP_M = 0.25

_Samples: TypeAlias = tuple[FloatArray, FloatArray]  # arc lengths and points of a centreline


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """One stretch on which two lanes are in each other's way.

    Attributes:
        kind: ``cross``, ``merge`` (they come together) or ``diverge`` (they come apart). Overlaps of mere
            neighbours (touch) are not listed.
        lanes: the two lane ids.
        spans: arc length (start, end) on each of the two, m.
    """

    kind: str
    lanes: tuple[int, int]
    spans: tuple[tuple[float, float], tuple[float, float]]


def conflicts(lanes: Mapping[int, Lane]) -> list[Conflict]:
    """All conflict stretches between lanes, ordered by lane ids."""
    pairs = {(min(i, j), max(i, j)) for i, lane in lanes.items() for j in lane.conflicts if j in lanes}
    pairs -= {(i, j) for i, j in pairs if i == j}
    found: list[Conflict] = []
    sampled = {i: samples(lanes[i].centreline, STEP_M) for i in {i for pair in pairs for i in pair}}
    for i, j in sorted(pairs):
        if _neighbours(lanes[i], lanes[j]) or j in lanes[i].successors or i in lanes[j].successors:
            continue
        found += _stretches(lanes[i], lanes[j], sampled[i], sampled[j])
    # Lanes that fork at the map's border have no common approach where a junction could begin: they stay
    # road, and whoever puts vehicles there must look at both.
    border = {i for i, lane in lanes.items() if not lane.predecessors}
    return [c for c in _kin(lanes, found) if not (c.kind == "diverge" and border.issuperset(c.lanes))]


def _kin(lanes: Mapping[int, Lane], found: list[Conflict]) -> list[Conflict]:
    """Recognise forks and merges that run over several short lanes.

    Two lanes that overlap from their starts on, without crossing, continue a fork if their predecessors are
    one lane or themselves diverge up to their ends; likewise for merges at the other end.
    """
    changed = True
    while changed:
        changed = False
        forks = {c.lanes for c in found if c.kind == "diverge"}
        merges = {c.lanes for c in found if c.kind == "merge"}
        for k, c in enumerate(found):
            if c.kind != "cross" or lines_cross(*(lanes[i].centreline for i in c.lanes)):
                continue
            a, b = (lanes[i] for i in c.lanes)
            if max(c.spans[0][0], c.spans[1][0]) < 2 * STEP_M and _related(
                a.predecessors, b.predecessors, forks
            ):
                found[k] = replace(c, kind="diverge")
            elif max(
                length_of(x.centreline) - s[1] for x, s in zip((a, b), c.spans, strict=True)
            ) < 2 * STEP_M and _related(a.successors, b.successors, merges):
                found[k] = replace(c, kind="merge")
            changed |= found[k] is not c
    return found


def _related(a: tuple[int, ...], b: tuple[int, ...], pairs: set[tuple[int, int]]) -> bool:
    return any(i == j or (min(i, j), max(i, j)) in pairs for i in a for j in b)


def lines_cross(a: FloatArray, b: FloatArray) -> bool:
    """Whether two polylines cross, common end points aside."""
    p, q = a[:-1, None], b[None, :-1]
    u, v = np.diff(a, axis=0)[:, None], np.diff(b, axis=0)[None]
    cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        w = q - p
        t = (w[..., 0] * v[..., 1] - w[..., 1] * v[..., 0]) / cross
        s = (w[..., 0] * u[..., 1] - w[..., 1] * u[..., 0]) / cross
    hit = (cross != 0) & (t >= 0) & (t <= 1) & (s >= 0) & (s <= 1)
    points = (p + np.where(hit, t, 0.0)[..., None] * u)[hit]
    ends = np.array([a[0], a[-1], b[0], b[-1]])
    return bool(
        np.any(np.hypot(*np.moveaxis(points[:, None] - ends[None], 2, 0)).min(axis=1, initial=np.inf) > 0.1)
    )


def _neighbours(a: Lane, b: Lane) -> bool:
    return b.lane_id in (a.left, a.right, a.adjacent_left, a.adjacent_right)


def _stretches(a: Lane, b: Lane, samples_a: _Samples, samples_b: _Samples) -> list[Conflict]:
    clearance = min(CLEARANCE_M, 0.45 * (a.width_m + b.width_m))
    (sa, pa), (sb, pb) = samples_a, samples_b
    on_b, gap_a = project_near(pa, b.centreline, clearance)
    if not (gap_a < clearance).any():
        return []
    _, gap_b = project_near(pb, a.centreline, clearance)
    found = []
    for first, last in runs(gap_a < clearance):
        low, high = sorted((float(on_b[first : last + 1].min()), float(on_b[first : last + 1].max())))
        span_b = _run_around(sb, gap_b < clearance, low, high)
        span_a = (float(sa[first]), float(sa[last]))
        kind = _kind(a, b, span_a, span_b, gap_a[first : last + 1])
        found.append(Conflict(kind=kind, lanes=(a.lane_id, b.lane_id), spans=(span_a, span_b)))
    return found


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return list(
        zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True)
    )


def _run_around(s: FloatArray, close: BoolArray, low: float, high: float) -> tuple[float, float]:
    """The stretch of the other lane that belongs to a run: its own runs that touch [low, high]."""
    for first, last in runs(close):
        if s[last] >= low - STEP_M and s[first] <= high + STEP_M:
            low, high = min(low, float(s[first])), max(high, float(s[last]))
    return low, high


def _kind(a: Lane, b: Lane, span_a: tuple[float, float], span_b: tuple[float, float], gap: FloatArray) -> str:
    """Tell crossing, merging and diverging apart by the stretch alone; chains of short lanes need that."""
    if opposed(a.centreline, b.centreline, span_a, span_b):
        return "cross"
    ends = [length_of(a.centreline) - span_a[1], length_of(b.centreline) - span_b[1]]
    starts = [span_a[0], span_b[0]]
    at_start, at_end = max(starts) < 2 * STEP_M, max(ends) < 2 * STEP_M
    if at_end and set(a.successors) & set(b.successors):
        return "merge"
    if at_start and set(a.predecessors) & set(b.predecessors):
        return "diverge"
    # Longer chains: the lanes come closest at the end where they meet the rest of the chain.
    low = float(gap.min()) + 0.1
    at_start, at_end = min(starts) < 2 * STEP_M, min(ends) < 2 * STEP_M
    if at_start and gap[0] <= low and not (at_end and gap[-1] < gap[0]):
        return "diverge"
    if at_end and gap[-1] <= low:
        return "merge"
    return "cross"


def opposed(a: FloatArray, b: FloatArray, span_a: tuple[float, float], span_b: tuple[float, float]) -> bool:
    """Whether two polylines run against each other (by more than 120 degrees) along a stretch of each."""
    da, db = (np.diff(along(line, np.array(span)), axis=0)[0] for line, span in ((a, span_a), (b, span_b)))
    size = math.hypot(*da) * math.hypot(*db)
    return size > 0 and float(da @ db) / size < -0.5
