"""Polylines of the SUMO net: arc length, cutting, joining, headings, text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from scex_sumo.arrays import FloatArray

DECIMALS = 3  # millimetres: a tenth of what the 0.01 m target needs, and what SUMO's tools expect


def arc(line: FloatArray) -> FloatArray:
    """(P,) arc length at each point of a polyline (P, 2), m."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def length(line: FloatArray) -> float:
    """Length of a polyline (P, 2), m."""
    return float(arc(line)[-1])


def at(line: FloatArray, s: FloatArray | float) -> FloatArray:
    """Points (..., 2) of a polyline (P, 2) at arc lengths ``s``, clipped to its ends."""
    along = arc(line)
    return np.stack([np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])], axis=-1)


def cut(line: FloatArray, start: float, end: float) -> FloatArray:
    """Part of a polyline (P, 2) between two arc lengths; at least two points."""
    along = arc(line)
    inside = (along > start + 1e-6) & (along < end - 1e-6)
    return np.vstack([at(line, start)[None], line[inside], at(line, end)[None]])


def join(parts: Sequence[FloatArray]) -> FloatArray:
    """Concatenation of polylines; points that repeat the previous one are dropped."""
    line = np.vstack(parts)
    keep = np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > 1e-4])
    return line[keep] if keep.sum() > 1 else line[[0, -1]]


def samples(line: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Arc lengths (N,) and points (N, 2) along a polyline, at most ``step`` apart, ends included."""
    total = length(line)
    s = np.linspace(0.0, total, max(2, math.ceil(total / step) + 1))
    return s, at(line, s)


def heading(line: FloatArray, *, end: bool, reach: float = 2.0) -> float:
    """Heading at the start or end of a polyline, rad, over its first or last ``reach`` metres."""
    total = length(line)
    reach = min(reach, total)
    a, b = (total - reach, total) if end else (0.0, reach)
    (x0, y0), (x1, y1) = at(line, a), at(line, b)
    return math.atan2(y1 - y0, x1 - x0)


def turn(before: float, after: float) -> float:
    """Signed change of heading in (-pi, pi], positive to the left, rad."""
    return math.remainder(after - before, 2 * math.pi)


def mean_width(left: FloatArray, right: FloatArray, centreline: FloatArray) -> float:
    """Mean distance of two bounds measured along a centreline, m.

    At each of some points of the centreline: distance to the left bound plus distance to the right one.
    """
    _, points = samples(centreline, 1.0)
    return float(np.mean(distances(points, left) + distances(points, right)))


def mean_line(lines: Sequence[FloatArray]) -> FloatArray:
    """The line in the middle of some lines side by side, taken at equal fractions of their lengths."""
    if len(lines) == 1:
        return lines[0]
    share = np.unique(np.concatenate([arc(line) / length(line) for line in lines]).round(9))
    return np.asarray(np.mean([at(line, share * length(line)) for line in lines], axis=0))


def distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """(N,) distance of points (N, 2) to a polyline (P, 2), m."""
    return project(points, line)[1]


def project(points: FloatArray, line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Arc length (N,) of the nearest point of a polyline and distance (N,) to it."""
    start, step = line[:-1], np.diff(line, axis=0)
    square = np.maximum((step**2).sum(1), 1e-18)
    offset = points[:, None, :] - start[None]
    t = np.clip((offset * step[None]).sum(2) / square, 0.0, 1.0)
    gap = np.hypot(*np.moveaxis(offset - t[..., None] * step[None], 2, 0))
    best = gap.argmin(axis=1)
    rows = np.arange(len(points))
    return arc(line)[best] + t[rows, best] * np.sqrt(square[best]), gap[rows, best]


def text(line: FloatArray) -> str:
    """A polyline as SUMO writes it: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(f"{x:.{DECIMALS}f},{y:.{DECIMALS}f}" for x, y in np.round(line, DECIMALS) + 0.0)


def bend(shape: FloatArray) -> float:
    """Signed change of heading along a polyline, summed over its points, rad."""
    steps = np.diff(shape, axis=0)
    angles = np.arctan2(steps[:, 1], steps[:, 0])
    return float(sum(turn(a, b) for a, b in pairwise(angles)))
