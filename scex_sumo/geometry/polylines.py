"""Polylines in the plane, (P, 2) arrays in metres, and paths sampled at equal distances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, clipped

COARSE = 8  # samples between two of the first step of a projection
COLUMNS = ("x", "y", "cos", "sin", "heading", "curvature")
POINTS_AT_ONCE = 1 << 10  # their distances to all samples fit the processor's cache
LAP_WEIGHT = 0.01  # (m off the path)² per (m off the expected arc length)²
Feet: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""(n,) arc lengths, m; distances from the paths, m, left positive; headings of the paths there, unwrapped."""


def wrap(angle: Any) -> Any:
    """Wrap an angle to [-pi, pi]; an angle within it is unchanged to the bit."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def turn(before: float, after: float) -> float:
    """Return the signed change of heading in (-pi, pi], positive to the left, rad."""
    return math.remainder(after - before, 2 * math.pi)


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the (P,) arc length at each point, m."""
    step = points[1:] - points[:-1]
    arc: FloatArray = np.zeros(len(points))
    np.hypot(step[:, 0], step[:, 1]).cumsum(out=arc[1:])
    return arc


def length_of(points: FloatArray) -> float:
    """Return the length of a polyline, m."""
    return float(arc_lengths(points)[-1])


def along(line: FloatArray, s: FloatArray | float) -> FloatArray:
    """Return points (..., 2) of a polyline at arc lengths, clamped to its ends."""
    arc = arc_lengths(line)
    points: FloatArray = np.empty((*np.shape(s), 2))
    points[..., 0], points[..., 1] = np.interp(s, arc, line[:, 0]), np.interp(s, arc, line[:, 1])
    return points


def samples(line: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return arc lengths (N,) and points (N, 2) along a polyline, at most ``step`` apart, ends included."""
    total = length_of(line)
    s = np.linspace(0.0, total, max(2, math.ceil(total / step) + 1))
    return s, along(line, s)


def cut(line: FloatArray, start: float, end: float) -> FloatArray:
    """Return the part of a polyline between two arc lengths; at least two points."""
    arc = arc_lengths(line)
    inside = np.flatnonzero((arc > start + 1e-6) & (arc < end - 1e-6))
    result: FloatArray = np.empty((len(inside) + 2, 2))
    result[1:-1] = line[inside]
    result[[0, -1], 0] = np.interp((start, end), arc, line[:, 0])
    result[[0, -1], 1] = np.interp((start, end), arc, line[:, 1])
    return result


def without_repeats(points: FloatArray) -> FloatArray:
    """Drop points of (P, 2) that equal the previous one."""
    if len(points) < 2:
        return points
    moved: BoolArray = np.any(points[1:] != points[:-1], axis=1)
    kept: FloatArray = points[np.concatenate([[True], moved])]
    return kept


def headings(points: FloatArray) -> FloatArray:
    """Return (S,) directions of the segments that have a length, rad."""
    step = np.diff(points, axis=0)
    step = step[np.hypot(step[:, 0], step[:, 1]) > 1e-6]
    if not len(step):
        return np.zeros(1)
    return np.arctan2(step[:, 1], step[:, 0])


def heading(line: FloatArray, *, end: bool, reach: float = 2.0) -> float:
    """Return the heading of a polyline over its first or last ``reach`` metres, rad."""
    total = length_of(line)
    reach = min(reach, total)
    a, b = (total - reach, total) if end else (0.0, reach)
    (x0, y0), (x1, y1) = along(line, a), along(line, b)
    return math.atan2(y1 - y0, x1 - x0)


def curvature(points: FloatArray) -> FloatArray:
    """Return (K, N) curvatures of paths (K, N, 2), 1/m, left positive."""
    first = np.gradient(points, axis=1)
    second = np.gradient(first, axis=1)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    speed = np.hypot(first[..., 0], first[..., 1])
    return np.asarray(cross / np.maximum(speed, 1e-6) ** 3)


def nearest(points: FloatArray, x: float, y: float) -> float:
    """Return the arc length of the point of a polyline nearest to (x, y), m."""
    return float(project(np.array([[x, y]]), points)[0][0])


def project(
    points: FloatArray, line: FloatArray, arc: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return (N,) arc lengths of the nearest points of a polyline to points (N, 2), and distances, m.

    ``arc``: arc length of each point of the line, m; None: from its begin on.
    """
    arc = arc_lengths(line) if arc is None else arc
    step = np.diff(line, axis=0)
    dx, dy = step[:, 0], step[:, 1]
    square = np.maximum(dx * dx + dy * dy, 1e-18)
    x, y = points[:, :1] - line[:-1, 0], points[:, 1:] - line[:-1, 1]
    t = np.clip((x * dx + y * dy) / square, 0.0, 1.0)
    gap = np.hypot(x - t * dx, y - t * dy)
    best = gap.argmin(axis=1)
    rows = np.arange(len(points))
    return arc[best] + t[rows, best] * np.sqrt(square[best]), gap[rows, best]


def distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return the (N,) distance of points (N, 2) to a polyline, m."""
    return project(points, line)[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """P paths of N samples each; they go on straight past both ends."""

    spacing: FloatArray  # (P,) arc length between two samples, m
    x: FloatArray  # (P, N) m; so ``y``
    y: FloatArray
    heading: FloatArray  # (P, N) rad, without jumps of 2 pi

    @property
    def samples(self) -> int:
        """N."""
        return int(self.x.shape[1])

    @cached_property
    def table(self) -> FloatArray:
        """(P * N, 12) each of `COLUMNS`, then its change to the next sample; m, rad, 1/m."""
        curvature = np.gradient(self.heading, axis=1) / self.spacing[:, None]
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        columns = np.stack([self.x, self.y, cos, sin, self.heading, curvature], -1)
        slope = np.diff(columns, axis=1, append=columns[:, -1:])
        slope[:, -1, :2] = self.spacing[:, None] * columns[:, -1, 2:4]  # straight on
        return np.concatenate([columns, slope], -1).reshape(-1, 2 * len(COLUMNS))

    @cached_property
    def centre(self) -> FloatArray:
        """(2,) mean of all samples, m."""
        return np.asarray(np.stack([self.x, self.y], -1).reshape(-1, 2).mean(axis=0))

    @cached_property
    def coarse(self) -> FloatArray:
        """(P, 3, M) every `COARSE`-th sample as -2x, -2y, x² + y², relative to `centre`, m."""
        shifted = np.stack([self.x[:, ::COARSE], self.y[:, ::COARSE]], -1) - self.centre
        return np.stack([-2 * shifted[..., 0], -2 * shifted[..., 1], (shifted**2).sum(-1)], 1)

    @cached_property
    def bend(self) -> tuple[FloatArray, FloatArray]:
        """(P * N,) curvature and its change to the next sample, 1/m, each contiguous."""
        return np.ascontiguousarray(self.table[:, 5]), np.ascontiguousarray(self.table[:, 11])

    def sample_at(self, path: IntArray, s: FloatArray) -> IntArray:
        """Return flat indices into (P * N) of the last samples before arc lengths (n,), m, on paths (n,)."""
        index: IntArray = clipped(s / self.spacing[path], 0.0, self.samples - 1.0).astype(np.int64)
        return path * self.samples + index

    def at(self, path: IntArray, s: FloatArray) -> FloatArray:
        """Return (6, n) `COLUMNS` at arc lengths (n,), m, on paths (n,): linear between samples."""
        position = s / self.spacing[path]
        index = clipped(position, 0.0, self.samples - 1.0).astype(np.int64)
        values = np.ascontiguousarray(self.table.take(path * self.samples + index, axis=0).T)
        inner: FloatArray = values[:6] + values[6:] * (position - index)
        return inner

    def bend_at(self, path: IntArray, s: FloatArray) -> FloatArray:
        """Return (n,) curvatures at arc lengths, 1/m."""
        position = clipped(s / self.spacing[path], 0.0, self.samples - 1.0)
        index = position.astype(np.int64)
        sample = path * self.samples + index
        bend: FloatArray = self.bend[0].take(sample) + self.bend[1].take(sample) * (position - index)
        return bend

    def refine(self, path: IntArray, s: FloatArray, x: FloatArray, y: FloatArray, steps: int) -> Feet:
        """Move first guesses of arc lengths to the foot points."""
        for _ in range(steps):
            px, py, cos, sin, heading, curvature = self.at(path, s)
            dx, dy = x - px, y - py
            ahead = cos * dx + sin * dy
            offset = cos * dy - sin * dx
            # Newton; the bound keeps it on this branch where the path bends around the point.
            step = ahead / np.maximum(1 - curvature * offset, 0.3)
            most = COARSE * self.spacing[path]
            s = s + clipped(step, -most, most)
        px, py, cos, sin, heading, _ = self.at(path, s)
        return s, cos * (y - py) - sin * (x - px), heading

    def foot_points(self, path: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray) -> Feet:
        """Project points onto their paths; see `refine` for the result.

        ``expected``: (n,) rough arc length, m, which decides where a path passes a place twice.
        """
        first = np.empty(len(path))
        for start in range(0, len(path), POINTS_AT_ONCE):
            batch = slice(start, start + POINTS_AT_ONCE)
            nearest = self._nearest_sample(path[batch], x[batch], y[batch], expected[batch])
            first[batch] = nearest * (COARSE * self.spacing[path[batch]])
        return self.refine(path, first, x, y, 4)

    def _nearest_sample(self, path: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray) -> IntArray:
        coarse = self.coarse.take(path, axis=0)
        dx, dy = (x - self.centre[0])[:, None], (y - self.centre[1])[:, None]
        square = coarse[:, 0] * dx
        square += coarse[:, 1] * dy
        square += coarse[:, 2]
        # Two laps of a roundabout differ by centimetres in distance and some 50 m in arc length.
        off = COARSE * self.spacing[path][:, None] * np.arange(coarse.shape[2]) - expected[:, None]
        off *= off
        off *= LAP_WEIGHT
        square += off
        nearest: IntArray = np.argmin(square, axis=1)
        return nearest
