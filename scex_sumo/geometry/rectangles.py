"""Rectangles of vehicles: distance, overlap and separation of many pairs; states in a vehicle's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, Rows
from scex_sumo.scene import States

SEEN_COLUMNS = ("x", "y", "cos", "sin", "speed")

BOX = np.array([(0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5)])
"""Outline of a vehicle as shares of its length (forwards) and width (to the left)."""

Two: TypeAlias = tuple[FloatArray, FloatArray]
_FLAT_M = 1e-6  # an edge that rises by less is level
_CORNERS = (1.0, -1.0, -1.0, 1.0), (1.0, 1.0, -1.0, -1.0)  # sides of length and width, around the rectangle
_NEXT = [1, 2, 3, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rectangles(Rows):
    """Oriented rectangles, (N,) centre, direction of the length (rad) and half sizes, m."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    half_length: FloatArray
    half_width: FloatArray

    @classmethod
    def of(cls, states: States, length: FloatArray, width: FloatArray) -> Rectangles:
        """Return the outlines of vehicles; lengths and widths, m, broadcast to the states."""
        x, y, heading = states.x, states.y, states.heading
        return cls(x=x, y=y, heading=heading, half_length=length / 2, half_width=width / 2)


def outlines(states: States, length: FloatArray, width: FloatArray, shape: FloatArray = BOX) -> FloatArray:
    """Return (..., P, 2) outlines in m of vehicles; lengths and widths broadcast to the states.

    ``shape`` holds (P, 2) shares of length and width.
    """
    ahead = np.stack([np.cos(states.heading), np.sin(states.heading)], axis=-1)
    along = ahead * np.asarray(length)[..., None]
    across = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1) * np.asarray(width)[..., None]
    centre = np.stack([states.x, states.y], axis=-1)
    return np.stack([centre + a * along + b * across for a, b in shape], axis=-2)


def relative_pose(
    first: Rectangles, second: Rectangles
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return centre x, y and direction cos, sin of the second rectangles in the frames of the first."""
    dx, dy = second.x - first.x, second.y - first.y
    cos, sin = np.cos(first.heading), np.sin(first.heading)
    turn = second.heading - first.heading
    return cos * dx + sin * dy, cos * dy - sin * dx, np.cos(turn), np.sin(turn)


def overlap_area(first: Rectangles, second: Rectangles) -> FloatArray:
    """Return the (N,) area that two rectangles share, m²."""
    x, y, cos, sin = relative_pose(first, second)
    along, across = (np.reshape(sign, (4, *[1] * np.ndim(x))) for sign in _CORNERS)
    corner_x = x + along * (second.half_length * cos) + across * (-second.half_width * sin)
    corner_y = y + along * (second.half_length * sin) + across * (second.half_width * cos)
    next_x, next_y = corner_x[_NEXT], corner_y[_NEXT]
    below = _clamped_integral(corner_x, corner_y, next_x, next_y, first.half_length, first.half_width)
    area: FloatArray = np.maximum(-below[0] - below[1] - below[2] - below[3], 0.0)
    return area


def _clamped_integral(
    x0: FloatArray, y0: FloatArray, x1: FloatArray, y1: FloatArray, a: FloatArray, b: FloatArray
) -> FloatArray:
    run = x1 - x0
    slope = (y1 - y0) / np.where(run == 0, 1.0, run)
    start, end = np.minimum(np.maximum(x0, -a), a), np.minimum(np.maximum(x1, -a), a)
    low, high = y0 + (start - x0) * slope, y0 + (end - x0) * slope
    rise = high - low
    level = np.abs(rise) < _FLAT_M
    mean = np.minimum(np.maximum((low + high) / 2, -b), b)
    steep = (_clamp_integral(high, b) - _clamp_integral(low, b)) / np.where(level, 1.0, rise)
    below: FloatArray = np.where(level, mean, steep) * (end - start)
    return below


def _clamp_integral(y: FloatArray, b: FloatArray) -> FloatArray:
    size = np.abs(y)
    return np.where(size <= b, 0.5 * y * y, b * size - 0.5 * b * b)


def axis_separations(first: Rectangles, second: Rectangles) -> FloatArray:
    """Return the gaps (4, N) between two rectangles along their four axes, m.

    The axes are the first one's length and width, then the second one's. A gap is negative where the
    projections overlap. None exceeds the distance.
    """
    x, y, cos, sin = relative_pose(first, second)
    c, s = np.abs(cos), np.abs(sin)
    gaps = np.empty((4, *np.shape(x)))
    gaps[0] = np.abs(x) - first.half_length - second.half_length * c - second.half_width * s
    gaps[1] = np.abs(y) - first.half_width - second.half_length * s - second.half_width * c
    gaps[2] = np.abs(x * cos + y * sin) - second.half_length - first.half_length * c - first.half_width * s
    gaps[3] = np.abs(y * cos - x * sin) - second.half_width - first.half_length * s - first.half_width * c
    return gaps


def separation(first: Rectangles, second: Rectangles) -> FloatArray:
    """Return the (N,) largest gap along the four axes, m; 0 or less if the rectangles touch."""
    gap: FloatArray = axis_separations(first, second).max(axis=0)
    return gap


def rectangle_distance(first: Rectangles, second: Rectangles) -> FloatArray:
    """Return the (N,) smallest distance between two rectangles, m; 0 if they touch or overlap."""
    directions = np.cos(first.heading), np.sin(first.heading), np.cos(second.heading), np.sin(second.heading)
    own, other = (first.half_length, first.half_width), (second.half_length, second.half_width)
    return distance_apart(second.x - first.x, second.y - first.y, directions, own, other)


def distance_apart(
    dx: FloatArray, dy: FloatArray, directions: tuple[FloatArray, ...], own: Two, other: Two
) -> FloatArray:
    """Return the distance (N,) of rectangles from offset of centres, directions, half lengths and widths, m.

    ``directions``: cosine and sine of the first ones, then of the second ones.

    Exact: disjoint convex polygons are nearest at a corner.
    """
    cos_1, sin_1, cos_2, sin_2 = directions
    cos, sin = cos_1 * cos_2 + sin_1 * sin_2, cos_1 * sin_2 - sin_1 * cos_2
    in_first = (dx * cos_1 + dy * sin_1, dy * cos_1 - dx * sin_1, cos, sin, *other, *own)
    in_second = (-(dx * cos_2 + dy * sin_2), -(dy * cos_2 - dx * sin_2), cos, -sin, *own, *other)
    squared = np.minimum(_corners_to_box(*in_first), _corners_to_box(*in_second))
    return np.where(separated(*in_first) | separated(*in_second), np.sqrt(squared), 0.0)


def _corners_to_box(*pose: FloatArray) -> FloatArray:
    """Return the (N,) smallest squared distance of a rectangle's corners to a box at the origin, m²."""
    x, y, cos, sin, half_length, half_width, box_length, box_width = pose
    along = (half_length * cos, half_length * sin)
    across = (-half_width * sin, half_width * cos)
    nearest = np.full(np.shape(x), np.inf)
    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        outside_x = np.maximum(np.abs(x + a * along[0] + b * across[0]) - box_length, 0)
        outside_y = np.maximum(np.abs(y + a * along[1] + b * across[1]) - box_width, 0)
        np.minimum(nearest, outside_x * outside_x + outside_y * outside_y, out=nearest)
    return nearest


def separated(*pose: FloatArray) -> BoolArray:
    """Return (N,) whether an axis of a box at the origin separates it from a rectangle.

    ``pose``: of the rectangle: x, y, cosine, sine, half length and width; then those of the box.
    """
    x, y, cos, sin, half_length, half_width, box_length, box_width = pose
    cos, sin = np.abs(cos), np.abs(sin)
    apart: BoolArray = np.abs(x) > box_length + half_length * cos + half_width * sin
    apart |= np.abs(y) > box_width + half_length * sin + half_width * cos
    return apart


def seen_from(now: States, states: States) -> FloatArray:
    """Return states (n..., k...) in the frames of vehicles (n...,): x ahead, y to the left.

    `SEEN_COLUMNS` (n..., k..., 5): x and y in m, cosine and sine of the relative heading, speed in m/s.
    """
    frame = (..., *(None,) * (len(states.shape) - len(now.shape)))
    turn = states.heading - now.heading[frame]
    seen = np.empty((*turn.shape, len(SEEN_COLUMNS)))
    seen[..., 0], seen[..., 1] = now.ahead_and_left(states.x, states.y)
    seen[..., 2], seen[..., 3], seen[..., 4] = np.cos(turn), np.sin(turn), states.speed
    return seen
