"""Planned paths ahead of each vehicle at every step, and their crossings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.crossings import (
    Polylines,
    boxes_meet,
    intersect,
    polyline_crossings,
    segment_boxes,
    segment_crossings,
)
from scex_sumo.metrics.base import STANDING_MPS, PlannedPaths
from scex_sumo.metrics.pairs.scenes import PairRows, Scenes

BLOCK_ROWS = 1 << 23  # bound of the crossing points of a block of pairs at all steps
SAME_POINT_M = 1e-9  # crossing points closer than this along the own path are one point


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings(PairRows):
    """Crossing points ahead of ordered pairs, in any order, several per pair.

    Attributes:
        own: (N,) arc length from the row's own vehicle to the point, m; ``other`` from the other vehicle.
    """

    own: FloatArray
    other: FloatArray
    sine: FloatArray  # (N,) of the angle between the paths, above 0


def bridged(x: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Fill gaps (NaN) in (N, H) coordinates: inner ones by straight lines, outer ones by the nearest value.

    Also return (N,) whether there was any value.
    """
    known = np.isfinite(x)
    if known.all():
        return x, np.ones(len(x), dtype=bool)
    column = np.broadcast_to(np.arange(x.shape[1]), x.shape)
    before = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, column, x.shape[1])[:, ::-1], axis=1)[:, ::-1]
    has_any: BoolArray = np.any(known, axis=1)
    left = np.where(before >= 0, before, np.where(after < x.shape[1], after, 0))
    right = np.where(after < x.shape[1], after, left)
    low, high = np.take_along_axis(x, left, axis=1), np.take_along_axis(x, right, axis=1)
    share = (column - left) / np.maximum(right - left, 1)
    filled = np.where(right > left, low + (high - low) * share, low)
    return np.where(has_any[:, None], filled, 0.0), has_any


class PathsAhead:
    """Planned path of every vehicle at every step: a first segment to the plan's next column, then the plan.

    Attributes:
        lines: the plans, ordered by future, replan, vehicle.
        line: (V, C, T) index of the current plan; ``column`` (T,) its next column.
        has_path: (V, C, T); ``ahead`` the same, with ``moving_only`` only of moving vehicles.
        dx: (V, C, T) first segment, m; ``first_boxes`` the octagons around it.
        length: (V, C, T) of the whole path ahead, m.
        offset: (V, C, T) arc length from the vehicle less the plan's own, m.
    """

    def __init__(self, scenes: Scenes, planned: PlannedPaths, *, moving_only: bool = True) -> None:
        futures, replans, vehicles, columns = planned.x.shape
        shape = (futures * replans * vehicles, columns)
        x, some_x = bridged(planned.x.reshape(shape))
        y, some_y = bridged(planned.y.reshape(shape))
        vehicle, future = np.arange(vehicles)[:, None, None], np.arange(futures)[:, None]
        next_column = np.minimum(planned.column, columns - 1)
        self.scenes, self.planned = scenes, planned
        self.lines = Polylines.build(x, y)
        self.has_plan = some_x & some_y
        self.line = (future * replans + planned.index) * vehicles + vehicle
        self.column = planned.column
        moves: BoolArray = scenes.speed > (STANDING_MPS if moving_only else -np.inf)
        self.has_path = scenes.present & self.has_plan[self.line] & (planned.column < columns)
        self.ahead = self.has_path & moves
        self.dx = np.where(self.has_path, x[self.line, next_column] - scenes.x, 0.0)
        self.dy = np.where(self.has_path, y[self.line, next_column] - scenes.y, 0.0)
        self.first_length = np.hypot(self.dx, self.dy)
        self.offset = self.first_length - self.lines.arc[self.line, next_column]
        self.length = np.where(self.has_path, self.lines.arc[self.line, -1] + self.offset, 0.0)
        self.first_boxes = segment_boxes(scenes.x, scenes.y, scenes.x + self.dx, scenes.y + self.dy)

    @cached_property
    def next_crossings(self) -> Crossings:
        """The first crossing point on each ordered pair's own path."""
        return self.first_crossings()

    def first_crossings(self, *, min_sine: float = 0.0) -> Crossings:
        """Find the first crossing point on each ordered pair's own path, at large enough angles."""
        futures, replans, _, columns = self.planned.x.shape
        (first, second), count = self.scenes.pairs, self.scenes.count
        rows_per_pair = max(futures * columns * max(self.scenes.shape[1], replans), 1)
        size = max(BLOCK_ROWS // rows_per_pair, 1)
        parts = []
        for start in range(0, max(len(first), 1), size):
            one, two = first[start : start + size], second[start : start + size]
            crossings = self._crossings(one, two)
            if min_sine > 0:
                crossings = crossings.take(np.flatnonzero(crossings.sine >= min_sine))
            nearest = _first_on_own_path(crossings, 2 * len(one) * count)
            pair, scene = np.divmod(nearest.where, count)
            pair += start + np.where(pair < len(one), 0, len(first) - len(one))
            parts.append(replace(nearest, where=pair * count + scene))
        joined = Crossings.join(parts)
        return joined.take(np.argsort(joined.where))

    def _crossings(self, first: IntArray, second: IntArray) -> Crossings:
        one_order = Crossings.join(
            [self._between_plans(first, second), *self._with_first_segments(first, second)]
        )
        half = len(first) * self.scenes.count
        where = one_order.where
        reverse = Crossings(
            where=np.where(where < half, where + half, where - half),
            own=one_order.other,
            other=one_order.own,
            sine=one_order.sine,
        )
        return Crossings.join([one_order, reverse])

    def _between_plans(self, first: IntArray, second: IntArray) -> Crossings:
        futures, steps = self.scenes.shape
        replans, lines = self.planned.x.shape[1], self.lines
        path = np.arange(futures * replans)[:, None] * self.scenes.vehicles
        one, two = (path + first).reshape(-1), (path + second).reshape(-1)
        usable = np.flatnonzero(self.has_plan[one] & self.has_plan[two])
        hits, segment_1, segment_2 = polyline_crossings(lines, one[usable], two[usable])
        which = usable[hits.which]
        arc_1 = lines.arc_at(one[which], segment_1, hits.first)
        arc_2 = lines.arc_at(two[which], segment_2, hits.second)
        plan, pair = np.divmod(which, max(len(first), 1))
        future, replan = np.divmod(plan, replans)
        until = np.minimum(segment_1, segment_2)
        ahead = [(self.planned.index[t] == replan) & (until >= self.column[t]) for t in range(steps)]
        step, hit = np.nonzero(np.array(ahead).reshape(steps, which.size))
        at_1, at_2 = (first[pair[hit]], future[hit], step), (second[pair[hit]], future[hit], step)
        both = self.ahead[at_1] & self.ahead[at_2]
        crossings = Crossings(
            where=(pair[hit] * futures + future[hit]) * steps + step,
            own=arc_1[hit] + self.offset[at_1],
            other=arc_2[hit] + self.offset[at_2],
            sine=hits.sine[hit],
        )
        return crossings.take(np.flatnonzero(both))

    def _with_first_segments(self, first: IntArray, second: IntArray) -> tuple[Crossings, Crossings]:
        scenes, lines = self.scenes, self.lines
        ordered = np.concatenate([first, second]), np.concatenate([second, first])
        where = meeting_pairs(ordered, self.first_boxes, self.boxes_ahead, self.ahead)
        pair, scene = np.divmod(where, scenes.count)
        own, theirs = (side[pair] * scenes.count + scene for side in ordered)
        x, y, dx, dy = (a.reshape(-1) for a in (scenes.x, scenes.y, self.dx, self.dy))
        mine = x[own], y[own], dx[own], dy[own]
        first_length, offset = self.first_length.reshape(-1), self.offset.reshape(-1)
        hits = intersect(mine, (x[theirs], y[theirs], dx[theirs], dy[theirs]))
        hit = hits.which
        between_firsts = Crossings(
            where=where[hit],
            own=hits.first * first_length[own[hit]],
            other=hits.second * first_length[theirs[hit]],
            sine=hits.sine,
        )
        line = self.line.reshape(-1)[theirs]
        hits, segment = segment_crossings(*mine, lines, line)
        hit = hits.which
        with_plan = Crossings(
            where=where[hit],
            own=hits.first * first_length[own[hit]],
            other=offset[theirs[hit]] + lines.arc_at(line[hit], segment, hits.second),
            sine=hits.sine,
        )
        still_ahead = np.flatnonzero(segment >= self.column[where[hit] % scenes.shape[1]])
        return between_firsts, with_plan.take(still_ahead)

    @cached_property
    def boxes_ahead(self) -> FloatArray:
        """(4, 2, V, C, T) octagons around each path ahead, first segment included."""
        nodes = self.lines.octagons
        columns, which = np.unique(np.minimum(self.column, nodes.shape[2] - 1), return_inverse=True)
        low = np.empty((4, len(columns), nodes.shape[1]))  # of the nodes from each column on
        high = np.empty_like(low)
        for k in reversed(range(len(columns))):
            last = k + 1 == len(columns)
            until_next = nodes[:, :, columns[k] : None if last else columns[k + 1]]
            np.min(until_next, axis=2, out=low[:, k])
            np.max(until_next, axis=2, out=high[:, k])
            if not last:
                np.minimum(low[:, k], low[:, k + 1], out=low[:, k])
                np.maximum(high[:, k], high[:, k + 1], out=high[:, k])
        boxes = self.first_boxes.copy()
        current = which.reshape(-1), self.line
        for axis in range(4):
            np.minimum(boxes[axis, 0], low[axis][current], out=boxes[axis, 0], where=self.has_path)
            np.maximum(boxes[axis, 1], high[axis][current], out=boxes[axis, 1], where=self.has_path)
        return boxes


def meeting_pairs(
    pairs: tuple[IntArray, IntArray], own: FloatArray, others: FloatArray, present: BoolArray
) -> IntArray:
    """Find ordered pairs whose octagons meet, as ascending flat indices into (N, C, T).

    Args:
        own: (4, 2, V, C, T) octagons of vehicles as first of a pair; ``others`` as second.
        present: (V, C, T) where both octagons exist.
    """
    row, other = pairs
    _, futures, steps = present.shape
    if not present.all():  # octagons of absent vehicles meet nothing
        own, others = own.copy(), others.copy()
        own[0, 0][~present] = others[0, 0][~present] = np.inf
    # First over all steps together, then at each step.
    whole = [
        np.stack([b[:, 0].min(axis=-1, initial=np.inf), b[:, 1].max(axis=-1, initial=-np.inf)], axis=1)
        for b in (own, others)
    ]
    near = np.flatnonzero(boxes_meet(whole[0][:, :, row], whole[1][:, :, other]))
    pair, future = np.divmod(near, max(futures, 1))
    one, two = row[pair] * futures + future, other[pair] * futures + future
    meet = np.ones((near.size, steps), dtype=bool)
    for axis in range(4):
        for low, high, first, second in ((own, others, one, two), (others, own, two, one)):
            meet &= low[axis, 0].reshape(-1, steps)[first] <= high[axis, 1].reshape(-1, steps)[second]
    entry, step = np.nonzero(meet)
    where: IntArray = near[entry] * steps + step
    return where


def _first_on_own_path(crossings: Crossings, size: int) -> Crossings:
    nearest = np.full(size, np.inf)
    np.minimum.at(nearest, crossings.where, crossings.own)
    same = crossings.take(np.flatnonzero(crossings.own <= nearest[crossings.where] + SAME_POINT_M))
    # If the other's path passes the same point twice, its first arrival counts.
    earliest = np.full(size, np.inf)
    np.minimum.at(earliest, same.where, same.other)
    first = np.flatnonzero(same.other == earliest[same.where])
    index = np.zeros(size, dtype=np.int64)
    index[same.where[first]] = first
    where = np.flatnonzero(np.isfinite(nearest))
    chosen = same.take(index[where])
    return Crossings(where=where, own=nearest[where], other=chosen.other, sine=chosen.sine)


def paths_ahead(scenes: Scenes) -> PathsAhead:
    """Return the planned paths of scenes; by `Scenes.once`."""
    assert scenes.planned is not None
    return PathsAhead(scenes, scenes.planned)
