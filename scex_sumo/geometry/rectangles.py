"""Distance between vehicle rectangles."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray


def rectangle_distance(
    *,
    dx: FloatArray,
    dy: FloatArray,
    cos_1: FloatArray,
    sin_1: FloatArray,
    cos_2: FloatArray,
    sin_2: FloatArray,
    length_1: FloatArray,
    width_1: FloatArray,
    length_2: FloatArray,
    width_2: FloatArray,
) -> FloatArray:
    """Smallest distance between two oriented rectangles, 0 where they touch or overlap.

    Args:
        dx: (N,) second centre minus first, m.
        dy: (N,) m.
        cos_1: (N,) direction of the first one's length.
        sin_1: (N,) the same.
        cos_2: (N,) direction of the second one's length.
        sin_2: (N,) the same.
        length_1: (N,) m, may be 0.
        width_1: (N,) m, may be 0.
        length_2: (N,) m.
        width_2: (N,) m.

    Returns:
        (N,) m. Exact: disjoint convex polygons are nearest at a corner of one of them.
    """
    half = (length_1 / 2, width_1 / 2, length_2 / 2, width_2 / 2)
    # The other's centre and axis in either rectangle's own frame.
    cos, sin = cos_1 * cos_2 + sin_1 * sin_2, cos_1 * sin_2 - sin_1 * cos_2
    in_first = (dx * cos_1 + dy * sin_1, dy * cos_1 - dx * sin_1)
    in_second = (-(dx * cos_2 + dy * sin_2), -(dy * cos_2 - dx * sin_2))
    reach_1 = _corners_to_box(*in_first, cos, sin, half[2], half[3], half[0], half[1])
    reach_2 = _corners_to_box(*in_second, cos, -sin, half[0], half[1], half[2], half[3])
    squared = np.minimum(reach_1, reach_2)
    apart = separated(*in_first, cos, sin, half[2], half[3], half[0], half[1])
    apart |= separated(*in_second, cos, sin, half[0], half[1], half[2], half[3])
    return np.where(apart, np.sqrt(squared), 0.0)


def _corners_to_box(
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
    box_length: FloatArray,
    box_width: FloatArray,
) -> FloatArray:
    """(N,) smallest squared distance of a rectangle's corners to an upright box around the origin, m²."""
    along = (half_length * cos, half_length * sin)
    across = (-half_width * sin, half_width * cos)
    nearest = np.full(np.shape(x), np.inf)
    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        outside_x = np.maximum(np.abs(x + a * along[0] + b * across[0]) - box_length, 0)
        outside_y = np.maximum(np.abs(y + a * along[1] + b * across[1]) - box_width, 0)
        np.minimum(nearest, outside_x * outside_x + outside_y * outside_y, out=nearest)
    return nearest


def separated(
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
    box_length: FloatArray,
    box_width: FloatArray,
) -> BoolArray:
    """(N,) whether an axis of the box separates it from the rectangle (separating axis theorem)."""
    cos, sin = np.abs(cos), np.abs(sin)
    apart: BoolArray = np.abs(x) > box_length + half_length * cos + half_width * sin
    apart |= np.abs(y) > box_width + half_length * sin + half_width * cos
    return apart
