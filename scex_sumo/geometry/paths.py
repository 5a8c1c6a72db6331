"""Paths along which something drives: samples at equal distances, curvatures, projection of points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, clipped

COARSE = 8  # samples between two of the first step of a projection
COLUMNS = ("x", "y", "cos", "sin", "heading", "curvature")
POINTS_AT_ONCE = 1 << 10  # their distances to all samples fit the processor's cache
LAP_WEIGHT = 0.01  # (m off the path)² per (m off the expected arc length)²


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """P paths of N samples each; they go on straight past both ends.

    Attributes:
        spacing: (P,) arc length between two samples, m.
        x: (P, N) m; so ``y``.
        heading: (P, N) rad, without jumps of 2 pi.
    """

    spacing: FloatArray
    x: FloatArray
    y: FloatArray
    heading: FloatArray

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
        some = np.stack([self.x[:, ::COARSE], self.y[:, ::COARSE]], -1) - self.centre
        return np.stack([-2 * some[..., 0], -2 * some[..., 1], (some**2).sum(-1)], 1)

    @cached_property
    def bend(self) -> tuple[FloatArray, FloatArray]:
        """(P * N,) curvature and its change to the next sample, 1/m, each contiguous."""
        return np.ascontiguousarray(self.table[:, 5]), np.ascontiguousarray(self.table[:, 11])

    def sample_at(self, row: IntArray, s: FloatArray) -> IntArray:
        """Return flat indices into (P * N) of the last samples before arc lengths (n,), m, on paths (n,)."""
        index: IntArray = clipped(s / self.spacing[row], 0.0, self.samples - 1.0).astype(np.int64)
        return row * self.samples + index

    def at(self, row: IntArray, s: FloatArray) -> FloatArray:
        """Return (6, n) `COLUMNS` at arc lengths (n,), m, on paths (n,): linear between samples."""
        position = s / self.spacing[row]
        index = clipped(position, 0.0, self.samples - 1.0).astype(np.int64)
        values = np.ascontiguousarray(self.table.take(row * self.samples + index, axis=0).T)
        inner: FloatArray = values[:6] + values[6:] * (position - index)
        return inner

    def bend_at(self, row: IntArray, s: FloatArray) -> FloatArray:
        """Return (n,) curvatures at arc lengths, 1/m."""
        position = clipped(s / self.spacing[row], 0.0, self.samples - 1.0)
        index = position.astype(np.int64)
        at = row * self.samples + index
        bend: FloatArray = self.bend[0].take(at) + self.bend[1].take(at) * (position - index)
        return bend

    def refine(
        self, row: IntArray, s: FloatArray, x: FloatArray, y: FloatArray, steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move first guesses of arc lengths to the foot points.

        Returns:
            (n,) arc length, m; (n,) distance, m, left positive; (n,) heading of the path, unwrapped.
        """
        for _ in range(steps):
            px, py, cos, sin, heading, curvature = self.at(row, s)
            dx, dy = x - px, y - py
            ahead = cos * dx + sin * dy
            offset = cos * dy - sin * dx
            # Newton; the bound keeps it on this branch where the path bends around the point.
            step = ahead / np.maximum(1 - curvature * offset, 0.3)
            most = COARSE * self.spacing[row]
            s = s + clipped(step, -most, most)
        px, py, cos, sin, heading, _ = self.at(row, s)
        return s, cos * (y - py) - sin * (x - px), heading

    def foot_points(
        self, row: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Project points onto their paths; see `refine` for the result.

        Args:
            expected: (n,) rough arc length, m, which decides where a path passes a place twice.
        """
        first = np.empty(len(row))
        for start in range(0, len(row), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            nearest = self._nearest_sample(row[part], x[part], y[part], expected[part])
            first[part] = nearest * (COARSE * self.spacing[row[part]])
        return self.refine(row, first, x, y, 4)

    def _nearest_sample(self, row: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray) -> IntArray:
        coarse = self.coarse.take(row, axis=0)
        dx, dy = (x - self.centre[0])[:, None], (y - self.centre[1])[:, None]
        square = coarse[:, 0] * dx
        square += coarse[:, 1] * dy
        square += coarse[:, 2]
        # Two laps of a roundabout differ by centimetres in distance and some 50 m in arc length.
        off = COARSE * self.spacing[row][:, None] * np.arange(coarse.shape[2]) - expected[:, None]
        off *= off
        off *= LAP_WEIGHT
        square += off
        nearest: IntArray = np.argmin(square, axis=1)
        return nearest
