"""Reference line: a smooth cubic curve in the middle of a group of lanes.

It meets the edges of the lanes at right angles, so that the next road begins where it ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, arc_lengths, heading, length_of
from scex_sumo.road import Lane

_MAX_PIECE_M, _MAX_PIECE_RAD = 5.0, 0.1  # length and turn of a piece
_MIN_PIECES = 3  # for cuts
_MIN_EDGE_M = 0.5  # for a reliable direction
_MAX_SKEW_RAD = math.radians(75)


Group: TypeAlias = tuple[int, ...]  # ids of lanes side by side, leftmost first


def borders(lanes: Mapping[int, Lane], group: Group) -> list[FloatArray]:
    """Return the left border of the leftmost lane, then each lane's right border, m."""
    return [lanes[group[0]].left_bound, *(lanes[i].right_bound for i in group)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Cubic pieces between K knots, by arc length.

    Attributes:
        s: (K,) arc lengths, m.
        points: (K, 2) m.
        tangents: (K, 2) unit vectors.
    """

    s: FloatArray
    points: FloatArray
    tangents: FloatArray

    def at(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (N, 2) and unit tangents (N, 2) at arc lengths (N,)."""
        from scipy.interpolate import CubicHermiteSpline

        spline = CubicHermiteSpline(self.s, self.points, self.tangents)
        slope = spline(s, 1)
        return spline(s), np.asarray(slope / np.hypot(slope[:, 0], slope[:, 1])[:, None])

    def part(self, first: int, last: int) -> Curve:
        """Return the curve between two knots."""
        chosen = slice(first, last + 1)
        return Curve(
            s=self.s[chosen] - self.s[first], points=self.points[chosen], tangents=self.tangents[chosen]
        )


def edge_direction(lines: Sequence[FloatArray], *, end: bool) -> FloatArray:
    """Return the (2,) unit driving direction across the first or last edge of borders, leftmost first."""
    index = -1 if end else 0
    headings = np.array([heading(line, end=end) for line in (lines[0], lines[-1])])
    ahead = np.array([np.cos(headings).sum(), np.sin(headings).sum()])
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
    across = lines[0][index] - lines[-1][index]
    width = float(np.hypot(*across))
    if width < _MIN_EDGE_M:
        return np.asarray(ahead)
    straight = np.array([across[1], -across[0]]) / width
    return straight if float(straight @ ahead) > math.cos(_MAX_SKEW_RAD) else ahead


def curve_through(
    lines: Sequence[FloatArray], directions: Sequence[FloatArray | None], *, spacing_m: float
) -> Curve:
    """Return the curve through the middle of a group.

    Args:
        lines: its borders, leftmost first.
        directions: (2,) unit vectors at its beginning and end; None: free.
        spacing_m: between points on the curve.
    """
    from scipy.interpolate import CubicSpline

    left, right = lines[0], lines[-1]
    size = (length_of(left) + length_of(right)) / 2
    share = np.linspace(0.0, 1.0, max(2, round(size / spacing_m) + 1))
    middle = (along(left, share * length_of(left)) + along(right, share * length_of(right))) / 2
    if all(direction is not None for direction in directions):
        first, last = _shifts(middle[-1] - middle[0], np.array(directions))
        middle = middle + (1 - share)[:, None] * first + share[:, None] * last
    middle = middle[np.concatenate([[True], np.hypot(*np.diff(middle, axis=0).T) > 1e-6])]
    chord = arc_lengths(middle)
    ends = [(2, np.zeros(2)) if direction is None else (1, direction) for direction in directions]
    spline = CubicSpline(chord, middle, bc_type=(ends[0], ends[1]))
    u = np.linspace(0.0, chord[-1], max(50, math.ceil(chord[-1] / 0.05)) + 1)
    slope = spline(u, 1)
    turns = np.diff(np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(turns))])
    effort = turned / _MAX_PIECE_RAD + arc_lengths(spline(u)) / _MAX_PIECE_M
    pieces = max(_MIN_PIECES, math.ceil(effort[-1]))
    knots = np.interp(np.linspace(0.0, effort[-1], pieces + 1), effort, u)
    points, slope = spline(knots), spline(knots, 1)
    tangents = slope / np.hypot(slope[:, 0], slope[:, 1])[:, None]
    s = np.concatenate([[0.0], np.cumsum(_sizes(points, tangents))])
    return Curve(s=s, points=points, tangents=tangents)


def _shifts(ahead: FloatArray, directions: FloatArray) -> FloatArray:
    """Return (2, 2) shifts from the middle of each edge along it, so that the curve turns less.

    A shift of 1 m costs as much as a turn of 0.02.

    Args:
        ahead: (2,) way between the edges.
        directions: (2, 2) at right angles to them.
    """
    across = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
    normal = across.sum(axis=0)
    weight = 1 / (np.hypot(*normal) * max(float(np.hypot(*ahead)), 1e-3))
    turn_per_m = weight * (across @ normal) * (-1, 1)
    size = -turn_per_m * weight * (ahead @ normal) / (turn_per_m @ turn_per_m + 0.02**2)
    return np.asarray(size[:, None] * across)


def _sizes(points: FloatArray, tangents: FloatArray) -> FloatArray:
    size = np.hypot(*np.diff(points, axis=0).T)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    u = ((nodes + 1) / 2)[None, :, None]
    p, q, v, w = (x[:, None] for x in (points[:-1], points[1:], tangents[:-1], tangents[1:]))
    for _ in range(8):
        scale = size[:, None, None]
        slope = 6 * (u**2 - u) * (p - q)
        slope = slope + (3 * u**2 - 4 * u + 1) * scale * v + (3 * u**2 - 2 * u) * scale * w
        size = (np.hypot(slope[..., 0], slope[..., 1]) * weights / 2).sum(axis=1)
    return np.asarray(size)
