"""Outlines of two vehicles that move on with their headings kept: how near, and how fast nearer."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.geometry.rectangles import separated


@dataclass(frozen=True, kw_only=True, eq=False)
class OutlinePairs:
    """N pairs of rectangles in motion.

    Attributes:
        dx: (N,) second centre minus first, m.
        dy: (N,) m.
        dvx: (N,) second velocity minus first, m/s.
        dvy: (N,) m/s.
        cos_1: (N,) direction of the first one's length.
        sin_1: (N,).
        cos_2: (N,) of the second one's.
        sin_2: (N,).
        half_length_1: (N,) m.
        half_width_1: (N,) m.
        half_length_2: (N,) m.
        half_width_2: (N,) m.
    """

    dx: FloatArray
    dy: FloatArray
    dvx: FloatArray
    dvy: FloatArray
    cos_1: FloatArray
    sin_1: FloatArray
    cos_2: FloatArray
    sin_2: FloatArray
    half_length_1: FloatArray
    half_width_1: FloatArray
    half_length_2: FloatArray
    half_width_2: FloatArray

    @property
    def own(self) -> tuple[FloatArray, FloatArray]:
        """(N,) half length and half width of the first one, m."""
        return self.half_length_1, self.half_width_1

    @property
    def other(self) -> tuple[FloatArray, FloatArray]:
        """(N,) of the second one, m."""
        return self.half_length_2, self.half_width_2

    def take(self, index: IntArray) -> OutlinePairs:
        """Some of them."""
        return OutlinePairs(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    def nearest(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) distance of the outlines at a time, m, and its slope, m/s; 0 and 0 where they touch."""
        dx, dy = self.dx + self.dvx * time, self.dy + self.dvy * time
        cos = self.cos_1 * self.cos_2 + self.sin_1 * self.sin_2
        sin = self.cos_1 * self.sin_2 - self.sin_1 * self.cos_2
        x_1, y_1 = dx * self.cos_1 + dy * self.sin_1, dy * self.cos_1 - dx * self.sin_1
        x_2, y_2 = dx * self.cos_2 + dy * self.sin_2, dy * self.cos_2 - dx * self.sin_2
        own, other = self.own, self.other
        square_1, ax, ay = _corner_to_box(x_1, y_1, cos, sin, *other, *own)
        square_2, bx, by = _corner_to_box(x_2, y_2, cos, -sin, *own, *other)
        apart = separated(x_1, y_1, cos, sin, *other, *own) | separated(x_2, y_2, cos, sin, *own, *other)
        from_1 = square_1 <= square_2
        # The vector from the first outline to the second one, in the map's frame.
        wx = np.where(from_1, ax * self.cos_1 - ay * self.sin_1, bx * self.cos_2 - by * self.sin_2)
        wy = np.where(from_1, ax * self.sin_1 + ay * self.cos_1, bx * self.sin_2 + by * self.cos_2)
        distance = np.where(apart, np.sqrt(np.minimum(square_1, square_2)), 0.0)
        safe = np.where(distance > 0, distance, 1.0)
        slope = np.where(distance > 0, (wx * self.dvx + wy * self.dvy) / safe, 0.0)
        return distance, slope


def _corner_to_box(
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
    box_length: FloatArray,
    box_width: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Squared distance of a rectangle's nearest corner to an upright box, and the vector there.

    The rectangle's centre is at (x, y) of the box's frame; the vector goes from box to corner.
    """
    along, across = (half_length * cos, half_length * sin), (-half_width * sin, half_width * cos)
    best = np.full(np.shape(x), np.inf)
    vector_x, vector_y = np.zeros(np.shape(x)), np.zeros(np.shape(x))
    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        px, py = x + a * along[0] + b * across[0], y + a * along[1] + b * across[1]
        px -= np.clip(px, -box_length, box_length)
        py -= np.clip(py, -box_width, box_width)
        square = px * px + py * py
        nearer = square < best
        np.copyto(best, square, where=nearer)
        np.copyto(vector_x, px, where=nearer)
        np.copyto(vector_y, py, where=nearer)
    return best, vector_x, vector_y
