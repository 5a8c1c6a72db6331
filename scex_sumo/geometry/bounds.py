"""Plane geometry of a lane's bounds."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray


def without_repeats(points: FloatArray) -> FloatArray:
    """Leave out points that equal the one before them.

    Args:
        points: (P, 2).
    """
    if len(points) < 2:
        return points
    moved: BoolArray = np.any(points[1:] != points[:-1], axis=1)
    kept: FloatArray = points[np.concatenate([[True], moved])]
    return kept


def mean_width_m(left: FloatArray, right: FloatArray) -> float:
    """Mean distance of two bounds: the area between them over the mean of their lengths.

    Args:
        left: (L, 2) m.
        right: (R, 2) m, in the same direction.
    """
    ring = np.concatenate([left, right[::-1]])
    x, y = (ring - ring[0]).T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    lengths = [float(np.hypot(*np.diff(bound, axis=0).T).sum()) for bound in (left, right)]
    return 2 * area / sum(lengths) if sum(lengths) > 0 else 0.0


def bounds_cross(left: FloatArray, right: FloatArray) -> bool:
    """Whether two bounds cross each other or one crosses itself; touching is no crossing.

    Args:
        left: (L, 2) m.
        right: (R, 2) m.
    """
    start = np.concatenate([left[:-1], right[:-1]])
    end = np.concatenate([left[1:], right[1:]])
    ahead = _side(start, end, start)  # (S, S): where each segment's start lies beside each segment
    behind = _side(start, end, end)
    apart = (ahead * behind) < 0
    return bool(np.any(apart & apart.T))


def _side(start: FloatArray, end: FloatArray, points: FloatArray) -> FloatArray:
    """(S, P) twice the area of the triangles of S segments and P points; positive on their left."""
    along = end - start
    to = points[None, :, :] - start[:, None, :]
    side: FloatArray = along[:, None, 0] * to[..., 1] - along[:, None, 1] * to[..., 0]
    return side
