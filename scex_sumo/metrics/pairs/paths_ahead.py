"""Planned paths at every step, and where they cross."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.crossings import (
    Polylines,
    boxes_meet,
    intersect,
    polyline_crossings,
    segment_boxes,
    segment_crossings,
)
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.pairs.scenes import Scenes

SAME_POINT_M = 1e-9  # crossing points closer than this along the own path are one point


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """Crossing points ahead of X ordered pairs at their steps, several per pair allowed.

    Attributes:
        where: (X,) flat index into (2P, C, T).
        own: (X,) arc length from the row's own vehicle to the crossing point, m.
        other: (X,) arc length from the other vehicle, m.
        sine: (X,) of the angle between the paths, above 0.
    """

    where: IntArray
    own: FloatArray
    other: FloatArray
    sine: FloatArray

    def take(self, index: IntArray) -> Crossings:
        """Some of them."""
        return Crossings(
            where=self.where[index], own=self.own[index], other=self.other[index], sine=self.sine[index]
        )


def bridged(x: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Coordinates with their gaps closed.

    Args:
        x: (N, H) m, NaN in gaps.

    Returns:
        (N, H) with inner gaps filled by straight lines and outer ones by the nearest value, and (N,) whether
        there was any value.
    """
    known = np.isfinite(x)
    if known.all():
        return x, np.ones(len(x), dtype=bool)
    column = np.broadcast_to(np.arange(x.shape[1]), x.shape)
    before = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, column, x.shape[1])[:, ::-1], axis=1)[:, ::-1]
    some: BoolArray = np.any(known, axis=1)
    left = np.where(before >= 0, before, np.where(after < x.shape[1], after, 0))
    right = np.where(after < x.shape[1], after, left)
    low, high = np.take_along_axis(x, left, axis=1), np.take_along_axis(x, right, axis=1)
    share = (column - left) / np.maximum(right - left, 1)
    filled = np.where(right > left, low + (high - low) * share, low)
    return np.where(some[:, None], filled, 0.0), some


class PathsAhead:
    """The planned path of every vehicle at every step: a first segment to the plan's next column, then the
    plan.

    Attributes:
        lines: the plans as polylines, child by child, replan by replan, vehicle by vehicle.
        line: (V, C, T) index of the current plan among ``lines``.
        column: (T,) the plan's next column.
        has_path: (V, C, T) whether there is a path ahead.
        ahead: (V, C, T) the same, of vehicles that move now if only those are asked for.
        dx: (V, C, T) first segment, m.
        dy: (V, C, T) m.
        first_length: (V, C, T) of the first segment, m.
        first_boxes: (4, 2, V, C, T) octagons around the first segments.
        length: (V, C, T) of the whole path ahead, m.
        offset: (V, C, T) what to add to the plan's own arc length to get the one from the vehicle, m.
    """

    def __init__(self, scenes: Scenes, planned: PlannedPaths, *, moving_only: bool = True) -> None:
        children, replans, vehicles, columns = planned.x.shape
        shape = (children * replans * vehicles, columns)
        x, some_x = bridged(planned.x.reshape(shape))
        y, some_y = bridged(planned.y.reshape(shape))
        vehicle, child = np.arange(vehicles)[:, None, None], np.arange(children)[:, None]
        next_column = np.minimum(planned.column, columns - 1)
        self.scenes, self.planned = scenes, planned
        self.lines = Polylines.build(x, y)
        self.has_plan = some_x & some_y
        self.line = (child * replans + planned.index) * vehicles + vehicle
        self.column = planned.column
        moves: BoolArray = scenes.speed > (scenes.parameters.standing_speed if moving_only else -np.inf)
        self.has_path = scenes.present & self.has_plan[self.line] & (planned.column < columns)
        self.ahead = self.has_path & moves
        self.dx = np.where(self.has_path, x[self.line, next_column] - scenes.x, 0.0)
        self.dy = np.where(self.has_path, y[self.line, next_column] - scenes.y, 0.0)
        self.first_length = np.hypot(self.dx, self.dy)
        self.offset = self.first_length - self.lines.arc[self.line, next_column]
        self.length = np.where(self.has_path, self.lines.arc[self.line, -1] + self.offset, 0.0)
        self.first_boxes = segment_boxes(scenes.x, scenes.y, scenes.x + self.dx, scenes.y + self.dy)

    @cached_property
    def crossings(self) -> Crossings:
        """All crossing points ahead of all ordered pairs."""
        found = [self._between_plans(), *self._with_first_segments()]
        where, own, other, sine = (
            np.concatenate([getattr(part, name) for part in found])
            for name in ("where", "own", "other", "sine")
        )
        half = len(self.scenes.pairs[0]) * int(np.prod(self.scenes.shape))
        opposite = np.where(where < half, where + half, where - half)
        return Crossings(
            where=np.concatenate([where, opposite]),
            own=np.concatenate([own, other]),
            other=np.concatenate([other, own]),
            sine=np.concatenate([sine, sine]),
        )

    def _between_plans(self) -> Crossings:
        """Crossings of the plans themselves: found once per plan, dealt out to its steps."""
        children, steps = self.scenes.shape
        first, second = self.scenes.pairs
        replans, lines = self.planned.x.shape[1], self.lines
        path = np.arange(children * replans)[:, None] * self.scenes.vehicles
        one, two = (path + first).reshape(-1), (path + second).reshape(-1)
        usable = np.flatnonzero(self.has_plan[one] & self.has_plan[two])
        hits, segment_1, segment_2 = polyline_crossings(lines, one[usable], two[usable])
        which = usable[hits.which]
        arc_1 = lines.arc_at(one[which], segment_1, hits.first)
        arc_2 = lines.arc_at(two[which], segment_2, hits.second)
        plan, pair = np.divmod(which, max(len(first), 1))
        child, replan = np.divmod(plan, replans)
        until = np.minimum(segment_1, segment_2)
        dealt = [(self.planned.index[t] == replan) & (until >= self.column[t]) for t in range(steps)]
        step, hit = np.nonzero(np.array(dealt).reshape(steps, which.size))
        at_1, at_2 = (first[pair[hit]], child[hit], step), (second[pair[hit]], child[hit], step)
        both = self.ahead[at_1] & self.ahead[at_2]
        found = Crossings(
            where=(pair[hit] * children + child[hit]) * steps + step,
            own=arc_1[hit] + self.offset[at_1],
            other=arc_2[hit] + self.offset[at_2],
            sine=hits.sine[hit],
        )
        return found.take(np.flatnonzero(both))

    def _with_first_segments(self) -> tuple[Crossings, Crossings]:
        """Crossings of a vehicle's first segment with the other's first segment and plan."""
        scenes, lines = self.scenes, self.lines
        where = meeting_pairs(scenes, self.first_boxes, self.boxes_ahead, self.ahead, self.ahead)
        row, theirs = scenes.flat_of(where)
        x, y, dx, dy = (a.reshape(-1) for a in (scenes.x, scenes.y, self.dx, self.dy))
        mine = x[row], y[row], dx[row], dy[row]
        first_length, offset = self.first_length.reshape(-1), self.offset.reshape(-1)
        hits = intersect(*mine, x[theirs], y[theirs], dx[theirs], dy[theirs])
        at = hits.which
        between_firsts = Crossings(
            where=where[at],
            own=hits.first * first_length[row[at]],
            other=hits.second * first_length[theirs[at]],
            sine=hits.sine,
        )
        line = self.line.reshape(-1)[theirs]
        hits, segment = segment_crossings(*mine, lines, line)
        at = hits.which
        with_plan = Crossings(
            where=where[at],
            own=hits.first * first_length[row[at]],
            other=offset[theirs[at]] + lines.arc_at(line[at], segment, hits.second),
            sine=hits.sine,
        )
        return between_firsts, with_plan.take(
            np.flatnonzero(segment >= self.column[where[at] % scenes.shape[1]])
        )

    @cached_property
    def boxes_ahead(self) -> FloatArray:
        """(4, 2, V, C, T) octagons around each path ahead, first segment included."""
        nodes = self.lines.octagons
        columns, which = np.unique(np.minimum(self.column, nodes.shape[2] - 1), return_inverse=True)
        low = np.empty((4, len(columns), nodes.shape[1]))  # of the nodes from each column on
        high = np.empty_like(low)
        for k in reversed(range(len(columns))):
            last = k + 1 == len(columns)
            part = nodes[:, :, columns[k] : None if last else columns[k + 1]]
            np.min(part, axis=2, out=low[:, k])
            np.max(part, axis=2, out=high[:, k])
            if not last:
                np.minimum(low[:, k], low[:, k + 1], out=low[:, k])
                np.maximum(high[:, k], high[:, k + 1], out=high[:, k])
        boxes = self.first_boxes.copy()
        at = which.reshape(-1), self.line
        for axis in range(4):
            np.minimum(boxes[axis, 0], low[axis][at], out=boxes[axis, 0], where=self.has_path)
            np.maximum(boxes[axis, 1], high[axis][at], out=boxes[axis, 1], where=self.has_path)
        return boxes


def meeting_pairs(
    scenes: Scenes, own: FloatArray, others: FloatArray, present: BoolArray, others_present: BoolArray
) -> IntArray:
    """Ordered pairs whose octagons meet, the first one's own and the other's.

    Args:
        scenes: the batch.
        own: (4, 2, V, C, T) octagons.
        others: (4, 2, V, C, T) octagons of the same vehicles as the second of a pair.
        present: (V, C, T) where there is an own octagon.
        others_present: (V, C, T) the same of the others.

    Returns:
        Flat indices into (2P, C, T), ascending.
    """
    children, steps = scenes.shape
    own, others = (_absent_nowhere(b, p) for b, p in ((own, present), (others, others_present)))
    # First whether they meet over all steps together, then at each.
    whole = [
        np.stack([b[:, 0].min(axis=-1, initial=np.inf), b[:, 1].max(axis=-1, initial=-np.inf)], axis=1)
        for b in (own, others)
    ]
    row, other = scenes.ordered_pairs
    near = np.flatnonzero(boxes_meet(whole[0][:, :, row], whole[1][:, :, other]))
    pair, child = np.divmod(near, max(children, 1))
    one, two = row[pair] * children + child, other[pair] * children + child
    meet = np.ones((near.size, steps), dtype=bool)
    for axis in range(4):
        for low, high, first, second in ((own, others, one, two), (others, own, two, one)):
            meet &= low[axis, 0].reshape(-1, steps)[first] <= high[axis, 1].reshape(-1, steps)[second]
    entry, step = np.nonzero(meet)
    return near[entry] * steps + step


def _absent_nowhere(boxes: FloatArray, present: BoolArray) -> FloatArray:
    """Octagons that meet nothing where they are absent."""
    if present.all():
        return boxes
    boxes = boxes.copy()
    boxes[0, 0][~present] = np.inf
    return boxes


def first_on_own_path(crossings: Crossings, size: int) -> Crossings:
    """Of each ordered pair's crossing points the one that comes first on the row's own vehicle's path.

    Args:
        crossings: all crossing points.
        size: number of ordered pairs times scenes.
    """
    nearest = np.full(size, np.inf)
    np.minimum.at(nearest, crossings.where, crossings.own)
    same = crossings.take(np.flatnonzero(crossings.own <= nearest[crossings.where] + SAME_POINT_M))
    # Where the other's path comes by the same point twice, its first arrival counts.
    earliest = np.full(size, np.inf)
    np.minimum.at(earliest, same.where, same.other)
    first = np.flatnonzero(same.other == earliest[same.where])
    index = np.zeros(size, dtype=np.int64)
    index[same.where[first]] = first
    where = np.flatnonzero(np.isfinite(nearest))
    chosen = same.take(index[where])
    return Crossings(where=where, own=nearest[where], other=chosen.other, sine=chosen.sine)


def paths_ahead(scenes: Scenes) -> PathsAhead:
    """The planned paths of scenes, for metrics that look at where they lead; made once for all of them."""
    return scenes.once(_paths_ahead)


def _paths_ahead(scenes: Scenes) -> PathsAhead:
    assert scenes.planned is not None
    return PathsAhead(scenes, scenes.planned)
