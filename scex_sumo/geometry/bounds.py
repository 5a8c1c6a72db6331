"""Bounds of lanes, as maps have them: middle lines, widths, bends, bounds that cross."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, arc_lengths, turn


def mean_line(lines: Sequence[FloatArray]) -> FloatArray:
    """Average lines side by side at equal fractions of their lengths."""
    return lines[0] if len(lines) == 1 else np.asarray(np.mean(point_by_point(lines), axis=0))


def point_by_point(lines: Sequence[FloatArray]) -> list[FloatArray]:
    """Return lines with points at equal fractions of their lengths, all of their own included."""
    arcs = [arc_lengths(line) for line in lines]
    share = np.unique(np.concatenate([arc / max(arc[-1], 1e-9) for arc in arcs]).round(9))
    return [along(line, share * arc[-1]) for line, arc in zip(lines, arcs, strict=True)]


def bend(shape: FloatArray) -> float:
    """Sum the signed changes of heading along a polyline, rad."""
    steps = np.diff(shape, axis=0)
    angles = np.arctan2(steps[:, 1], steps[:, 0])
    return float(sum(turn(a, b) for a, b in pairwise(angles)))


def mean_width_m(left: FloatArray, right: FloatArray) -> float:
    """Return the mean distance of two bounds in one direction: area between over mean length, m."""
    ring = np.concatenate([left, right[::-1]])
    x, y = (ring - ring[0]).T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    lengths = [float(np.hypot(*np.diff(bound, axis=0).T).sum()) for bound in (left, right)]
    return 2 * area / sum(lengths) if sum(lengths) > 0 else 0.0


def bounds_cross(left: FloatArray, right: FloatArray) -> bool:
    """Test whether two bounds (P, 2), m, of two points or more cross each other or one crosses itself."""
    first, second = shapely.LineString(left), shapely.LineString(right)
    return bool(first.crosses(second) or not (first.is_simple and second.is_simple))
