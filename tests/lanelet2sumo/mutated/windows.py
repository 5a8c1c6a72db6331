"""Maps cut as people cut them: by a window, by losing lanelets, with roads that end in the middle."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.geometry.polylines import cut, length_of, nearest, samples
from scex_sumo.road import Lane, Road
from tests.lanelet2sumo.judge.driving import judged
from tests.lanelet2sumo.mutated.cut_roads import cut_road, overlap

SHORTEST_M = 1.0  # of what a window leaves of a lane
STEP_M = 0.25


def dropped(road: Road, seed: int) -> Road:
    """The road without the lanes that a window does not hold whole."""
    window = _Window(road, np.random.default_rng(seed))
    return without(road, {i for i, lane in road.lanes.items() if not window.holds(lane.centreline).all()})


def clipped(road: Road, seed: int) -> Road:
    """The road with every lane cut where it leaves a window; of several stretches within the longest."""
    window = _Window(road, np.random.default_rng(seed))
    lanes: dict[int, Lane] = {}
    for i, lane in road.lanes.items():
        start, end = window.stretch(lane.centreline)
        if end - start >= SHORTEST_M:
            lanes[i] = _between(lane, start, end)
    kept = without(road, road.lanes.keys() - lanes.keys())
    for i, lane in lanes.items():
        before = kept.lanes[i].predecessors if _meet(lane.centreline[0], road.lanes[i].centreline[0]) else ()
        after = kept.lanes[i].successors if _meet(lane.centreline[-1], road.lanes[i].centreline[-1]) else ()
        before = tuple(j for j in before if _meet(lanes[j].centreline[-1], lane.centreline[0]))
        after = tuple(j for j in after if _meet(lanes[j].centreline[0], lane.centreline[-1]))
        near = tuple(j for j in kept.lanes[i].conflicts if overlap(lane, lanes[j]))
        lanes[i] = replace(
            kept.lanes[i], **_lines(lane), predecessors=before, successors=after, conflicts=near
        )
    return replace(kept, lanes=lanes)


def thinned(road: Road, seed: int) -> Road:
    """The road without a fifth of its lanes."""
    rng = np.random.default_rng(seed)
    return without(road, {i for i in road.lanes if rng.random() < 0.2})


def thirds(road: Road, seed: int) -> Road:
    """The road's lanes cut in three, without a seventh of the thirds."""
    rng = np.random.default_rng(seed)
    whole = cut_road(road, 3)
    return without(whole, {i for i in whole.lanes if rng.random() < 1 / 7})


WAYS: Mapping[str, Callable[[Road, int], Road]] = {f.__name__: f for f in (dropped, clipped, thinned, thirds)}


def without(road: Road, gone: Collection[int]) -> Road:
    """The road without some of its lanes, as a reader sees a map that lacks them."""

    def kept(lanes: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(i for i in lanes if i not in gone)

    def one(lane: int | None) -> int | None:
        return None if lane in gone else lane

    lanes = {
        i: replace(
            lane,
            successors=kept(lane.successors),
            predecessors=kept(lane.predecessors),
            conflicts=kept(lane.conflicts),
            left=one(lane.left),
            right=one(lane.right),
            adjacent_left=one(lane.adjacent_left),
            adjacent_right=one(lane.adjacent_right),
        )
        for i, lane in road.lanes.items()
        if i not in gone
    }
    rules = tuple(
        replace(rule, lanes=kept(rule.lanes), yielding=kept(rule.yielding), priority=kept(rule.priority))
        for rule in road.regulations
    )
    return replace(road, lanes=lanes, regulations=rules)


class _Window:
    """A rectangle, turned anyhow, that holds about half of a road."""

    def __init__(self, road: Road, rng: np.random.Generator) -> None:
        points = np.vstack([lane.centreline for lane in road.lanes.values() if lane.kind == "vehicle"])
        self._middle = points[rng.integers(len(points))]
        angle = rng.uniform(0.0, np.pi)
        self._axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        away = np.abs((points - self._middle) @ self._axes.T)
        self._half = np.quantile(away, rng.uniform(0.55, 0.9), axis=0) + 1.0

    def holds(self, points: FloatArray) -> np.ndarray:
        """(P,) whether points lie within."""
        return np.asarray((np.abs((points - self._middle) @ self._axes.T) <= self._half).all(axis=1))

    def stretch(self, line: FloatArray) -> tuple[float, float]:
        """The longest stretch of a polyline within, m."""
        s, points = samples(line, STEP_M)
        inside = np.concatenate([[False], self.holds(points), [False]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(inside) == 1), np.flatnonzero(np.diff(inside) == -1) - 1
        if not len(starts):
            return 0.0, 0.0
        best = int(np.argmax(s[ends] - s[starts]))
        return float(s[starts[best]]), float(s[ends[best]])


def _between(lane: Lane, start: float, end: float) -> Lane:
    length = length_of(lane.centreline)
    if start == 0.0 and end == length:
        return lane
    line = cut(lane.centreline, start, end)
    bounds = []
    for bound in (lane.left_bound, lane.right_bound):
        first = nearest(bound, *line[0]) if start > 0.0 else 0.0
        last = nearest(bound, *line[-1]) if end < length else length_of(bound)
        bounds.append(cut(bound, min(first, last - 0.01), last))
    return replace(lane, centreline=line, left_bound=bounds[0], right_bound=bounds[1])


def _lines(lane: Lane) -> dict[str, FloatArray]:
    return {name: getattr(lane, name) for name in ("centreline", "left_bound", "right_bound")}


def _meet(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.hypot(*(a - b)) < 0.01)


def judge(road: Road, folder: Path) -> list[str]:
    """What the net of a road misses after 120 cars have driven on it; a refusal in one line is none."""
    try:
        return judged(road, folder / "cut.net.xml").problems()
    except ScexError as error:
        return [f"refused: {error}"]
