"""Small geometry of polylines in the plane; points are (P, 2) arrays in metres."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray


def wrap(angle: Any) -> Any:
    """The same angle in [-pi, pi]."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def arc_lengths(points: FloatArray) -> FloatArray:
    """(P,) arc length at each point, m."""
    step = np.diff(points, axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])


def length_of(points: FloatArray) -> float:
    """Length of a polyline, m."""
    step = np.diff(points, axis=0)
    return float(np.hypot(step[:, 0], step[:, 1]).sum())


def along(points: FloatArray, s: FloatArray) -> FloatArray:
    """(n, 2) points at arc lengths, clamped to the ends."""
    arc = arc_lengths(points)
    return np.column_stack([np.interp(s, arc, points[:, 0]), np.interp(s, arc, points[:, 1])])


def headings(points: FloatArray) -> FloatArray:
    """(S,) directions of the segments that have a length, rad."""
    step = np.diff(points, axis=0)
    step = step[np.hypot(step[:, 0], step[:, 1]) > 1e-6]
    if not len(step):
        return np.zeros(1)
    return np.arctan2(step[:, 1], step[:, 0])


def nearest(points: FloatArray, x: float, y: float) -> float:
    """Arc length of the point of a polyline that is nearest to a place, m."""
    step = np.diff(points, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    safe = np.where(length > 0, length, 1.0)
    t = np.clip(((x - points[:-1, 0]) * step[:, 0] + (y - points[:-1, 1]) * step[:, 1]) / safe**2, 0.0, 1.0)
    distance = np.hypot(points[:-1, 0] + t * step[:, 0] - x, points[:-1, 1] + t * step[:, 1] - y)
    best = int(np.argmin(distance))
    return float(arc_lengths(points)[best] + t[best] * length[best])


def join(pieces: list[FloatArray], owners: list[int]) -> tuple[FloatArray, IntArray]:
    """One line out of several, without repeated points, and the owner of the line after each point."""
    points = np.vstack(pieces)
    owner = np.repeat(np.array(owners, dtype=np.int64), [len(p) for p in pieces])
    step = np.hypot(*np.diff(points, axis=0).T)
    keep = np.concatenate([step > 1e-6, [True]])
    return points[keep], owner[keep]


def blend_over(line: FloatArray, other: FloatArray, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Change smoothly from the end of one line to the other line beside it.

    Args:
        line: (P, 2) line to leave.
        other: (Q, 2) line to reach.
        length_m: length of the change; less where the line is shorter.

    Returns:
        The first line, its end bent over, and what remains of the other line.
    """
    arc = arc_lengths(line)
    start = max(0.0, arc[-1] - length_m)
    s = np.linspace(start, arc[-1], max(2, int((arc[-1] - start) / 1.0) + 1))
    here = along(line, s)
    s_other = np.maximum.accumulate([nearest(other, float(px), float(py)) for px, py in here])
    t = (s - start) / max(arc[-1] - start, 1e-9)
    weight = (t**3 * (10 - 15 * t + 6 * t**2))[:, None]  # slope and curvature are zero at both ends
    bent = (1 - weight) * here + weight * along(other, s_other)
    reached = arc_lengths(other)
    rest = np.vstack([along(other, s_other[-1:]), other[reached > s_other[-1]]])
    return np.vstack([line[arc < start], bent]), rest
