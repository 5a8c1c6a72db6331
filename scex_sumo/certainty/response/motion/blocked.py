"""Blocked stretch of a vehicle's line: where its box would touch the box of another vehicle.

A vehicle moves along a line. At each time, the other vehicle blocks one stretch of it. Two vehicles touch at
the times at which the first one's arc length is inside the stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.scene import States

COARSE_M = 4.0  # between the points that are compared first
JUMP_M = 10.0  # in a step: the line comes back to the same place, and another part of it is blocked now
ITERATIONS = 4  # of each end, where the line bends; on a straight line the first one is exact
AT_ONCE = 256  # pairs whose lines are compared at once


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Lines of n vehicles' centres, sampled in equal steps.

    Attributes:
        x: (n, N) m; y likewise.
        heading: (n, N) rad, without jumps of 2 pi.
        start: (n,) arc length of the first sample, m; 0 is the vehicle's present place.
        spacing_m: between samples.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    start: FloatArray
    spacing_m: float

    @classmethod
    def straight(cls, now: States, ahead_m: float, *, spacing_m: float = 1.0) -> Lines:
        """Return straight lines from 20 m behind to `ahead_m` before vehicles with states (n,)."""
        s = np.arange(-20.0, ahead_m + spacing_m, spacing_m)
        return cls(
            x=now.x[:, None] + s * np.cos(now.heading)[:, None],
            y=now.y[:, None] + s * np.sin(now.heading)[:, None],
            heading=np.repeat(now.heading[:, None], len(s), axis=1),
            start=np.full(len(now.x), s[0]),
            spacing_m=spacing_m,
        )

    def at(self, row: IntArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and heading of lines (m,) at arc lengths (m, ...); straight on past both ends."""
        row = row.reshape(row.shape + (1,) * (s.ndim - row.ndim))
        position = (s - self.start[row]) / self.spacing_m
        index = np.clip(position.astype(np.int64), 0, self.x.shape[1] - 2)
        share = position - index
        at, after = (row, index), (row, index + 1)
        x, y, heading = (values[at] for values in (self.x, self.y, self.heading))
        inside = np.clip(share, 0.0, 1.0)
        return (
            x + share * (self.x[after] - x),
            y + share * (self.y[after] - y),
            heading + inside * (self.heading[after] - heading),
        )

    def take(self, index: IntArray) -> Lines:
        """Select lines by index."""
        columns = (self.x[index], self.y[index], self.heading[index], self.start[index])
        return Lines(
            x=columns[0], y=columns[1], heading=columns[2], start=columns[3], spacing_m=self.spacing_m
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocked:
    """Stretch (m, T) of each line that another vehicle blocks, arc length of the centre, m.

    Attributes:
        enter: first blocked arc length; inf where none is.
        leave: last blocked arc length; -inf where none is.
    """

    enter: FloatArray
    leave: FloatArray

    def touches(self, s: FloatArray) -> BoolArray:
        """Return (m, ..., T) whether vehicles at arc lengths (m, ..., T) touch the other one at each time.

        It includes a vehicle that passes through the whole stretch in the step before, unless another stretch
        of its line is blocked then. A stretch that is blocked at one end of a step only is taken to be so in
        half of it.
        """
        middle = (slice(None),) + (None,) * (s.ndim - self.enter.ndim)
        enter, leave = self.enter[middle], self.leave[middle]
        hit = np.asarray((s > enter) & (s < leave))
        before, after = enter[..., :-1] < np.inf, enter[..., 1:] < np.inf
        through = before & after & (s[..., :-1] <= enter[..., :-1]) & (s[..., 1:] >= leave[..., 1:])
        with np.errstate(invalid="ignore"):
            through &= np.abs(np.diff(enter, axis=-1)) < JUMP_M
        half = (s[..., :-1] + s[..., 1:]) / 2
        begins = ~before & (half > enter[..., 1:]) & (half < leave[..., 1:])
        ends = ~after & (half > enter[..., :-1]) & (half < leave[..., :-1])
        hit[..., 1:] |= through | begins
        hit[..., :-1] |= ends
        return hit

    def touched(self, s: FloatArray) -> BoolArray:
        """Return (m, ...) whether vehicles at arc lengths (m, ..., T) touch the other one at some time."""
        return np.asarray(self.touches(s).any(axis=-1))

    def take(self, index: IntArray) -> Blocked:
        """Select rows by index."""
        return Blocked(enter=self.enter[index], leave=self.leave[index])


def blocked_stretches(
    lines: Lines, row: IntArray, length: FloatArray, width: FloatArray, other: Rectangles
) -> Blocked:
    """Return the stretches of lines that other vehicles block.

    Args:
        row: (m,) line of each pair.
        length: (m,) of the vehicle on the line, m; so ``width``.
        other: (m, T) outlines; half sizes (m, 1) or (m, T).
    """
    half = (length[:, None] / 2, width[:, None] / 2)
    nearest = _nearest(lines, row, other)
    begin, end = _slice(lines, row, nearest, half, other)
    reach = half[0] + np.hypot(other.half_length, other.half_width)
    ends = []
    for side, first in ((0, begin), (1, end)):
        at = np.where(np.isfinite(first), first, nearest + (2 * side - 1) * reach / 2)
        value = np.where(np.isfinite(first), first, np.nan)
        for _ in range(ITERATIONS):
            offset = _slice(lines, row, at, half, other)[side]
            there = np.isfinite(offset)
            value = np.where(there, offset, value)
            at = np.where(there, np.clip(offset, nearest - 2 * reach, nearest + 2 * reach), at)
        ends.append(value)
    enter, leave = ends
    nothing = ~((leave > enter) & np.isfinite(enter) & np.isfinite(leave))
    return Blocked(enter=np.where(nothing, np.inf, enter), leave=np.where(nothing, -np.inf, leave))


def _nearest(lines: Lines, row: IntArray, other: Rectangles) -> FloatArray:
    """Return the arc length (m, T) of the sample of each line nearest to the other vehicle."""
    every = max(1, round(COARSE_M / lines.spacing_m))
    sample = np.empty(other.x.shape, dtype=np.int64)
    for start in range(0, len(row), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        points = np.stack(
            [lines.x[:, ::every][row[part]], lines.y[:, ::every][row[part]]], axis=1
        )  # (m, 2, N)
        centre = points.mean(axis=2, keepdims=True)
        points = points - centre
        place = np.stack([other.x[part], other.y[part]], axis=-1) - centre.swapaxes(1, 2)
        cost = (points**2).sum(axis=1)[:, None] - 2 * place @ points
        sample[part] = np.argmin(cost, axis=2)
    return np.asarray(lines.start[row][:, None] + sample * every * lines.spacing_m)


def _slice(
    lines: Lines, row: IntArray, s: FloatArray, half: tuple[FloatArray, FloatArray], other: Rectangles
) -> tuple[FloatArray, FloatArray]:
    """Return the blocked stretch on the tangents of lines at arc lengths; inf and -inf where none is.

    Of two rectangles that move in parallel, each of the four separating axes allows one interval.
    """
    own_length, own_width = half
    x0, y0, heading = lines.at(row, s)
    cos0, sin0 = np.cos(heading), np.sin(heading)
    dx, dy = other.x - x0, other.y - y0
    x, y = cos0 * dx + sin0 * dy, cos0 * dy - sin0 * dx
    turn = other.heading - heading
    cos, sin = np.cos(turn), np.sin(turn)
    c, k = np.abs(cos), np.abs(sin)
    reach_x = own_length + other.half_length * c + other.half_width * k
    reach_y = own_width + other.half_length * k + other.half_width * c
    along = other.half_length + own_length * c + own_width * k
    across = other.half_width + own_length * k + own_width * c
    low, high = -reach_x, reach_x
    for factor, shift, reach in ((cos, y * sin, along), (sin, -y * cos, across)):
        size = np.where(np.abs(factor) > 1e-9, factor, 1e-9)
        middle, extent = -shift / size, reach / np.abs(size)
        low, high = np.maximum(low, middle - extent), np.minimum(high, middle + extent)
    apart = (np.abs(y) >= reach_y) | (low >= high)
    return np.where(apart, np.inf, s + x - high), np.where(apart, -np.inf, s + x - low)
