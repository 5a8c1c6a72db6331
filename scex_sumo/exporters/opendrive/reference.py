"""Reference line: a smooth cubic curve in the middle of a chain of lane groups.

It meets the edges of the lanes at right angles, so that the next road begins where it ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, arc_lengths, length_of
from scex_sumo.road import Lane

_MAX_PIECE_M, _MAX_PIECE_RAD = 5.0, 0.1  # length and turn of a piece
_MIN_PIECES = 3  # per group, for cuts
_MIN_EDGE_M = 0.5  # for a reliable direction
_MAX_SKEW_RAD = math.radians(75)


Group: TypeAlias = tuple[int, ...]  # lane ids, leftmost first
Chain: TypeAlias = tuple[Group, ...]  # groups that follow one another, lane by lane


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
    at = -1 if end else 0
    ahead = np.sum([_end_direction(line, end=end) for line in (lines[0], lines[-1])], axis=0)
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
    across = lines[0][at] - lines[-1][at]
    width = float(np.hypot(*across))
    if width < _MIN_EDGE_M:
        return np.asarray(ahead)
    straight = np.array([across[1], -across[0]]) / width
    return straight if float(straight @ ahead) > math.cos(_MAX_SKEW_RAD) else ahead


def curve_through(
    groups: Sequence[Sequence[FloatArray]], directions: Sequence[FloatArray | None], *, spacing_m: float
) -> tuple[Curve, list[int]]:
    """Return the curve through the middle of groups, and the last knot of each group.

    Args:
        groups: borders of each group, leftmost first.
        directions: (2,) unit vectors at the beginning of the first group and at the end of each; None: free.
        spacing_m: between points on the curve.
    """
    s, points, tangents, last = [np.zeros(1)], [], [], []
    shifts = _shifts(groups, directions)
    for k, lines in enumerate(groups):
        own_s, own_points, own_tangents = _group_pieces(
            lines, directions[k : k + 2], shifts[k : k + 2], spacing_m
        )
        if k:
            own_points, own_tangents = own_points[1:], own_tangents[1:]
        s.append(s[-1][-1] + own_s[1:])
        points.append(own_points)
        tangents.append(own_tangents)
        last.append(sum(map(len, points)) - 1)
    return Curve(s=np.concatenate(s), points=np.vstack(points), tangents=np.vstack(tangents)), last


def _end_direction(line: FloatArray, *, end: bool, reach_m: float = 2.0) -> FloatArray:
    size = length_of(line)
    a, b = (max(size - reach_m, 0.0), size) if end else (0.0, min(reach_m, size))
    step = along(line, b) - along(line, a)
    return np.asarray(step / max(float(np.hypot(*step)), 1e-9))


def _shifts(groups: Sequence[Sequence[FloatArray]], directions: Sequence[FloatArray | None]) -> FloatArray:
    """Return (G + 1, 2) shifts from the middle of each edge to the curve's crossing."""
    shifts = np.zeros((len(groups) + 1, 2))
    given = [d for d in directions if d is not None]
    if len(given) < len(directions):
        return shifts
    across = np.array([(-d[1], d[0]) for d in given])
    rows, wanted = [], []
    for k, lines in enumerate(groups):
        first = (lines[0][0] + lines[-1][0]) / 2
        last = (lines[0][-1] + lines[-1][-1]) / 2
        normal = across[k] + across[k + 1]
        weight = 1 / (np.hypot(*normal) * max(float(np.hypot(*(last - first))), 1e-3))
        row = np.zeros(len(given))
        row[k], row[k + 1] = -weight * (across[k] @ normal), weight * (across[k + 1] @ normal)
        rows.append(row)
        wanted.append(-weight * float((last - first) @ normal))
    # A shift of 1 m costs as much as a turn of 0.02.
    system = np.vstack([*rows, 0.02 * np.eye(len(given))])
    target = np.concatenate([wanted, np.zeros(len(given))])
    return np.asarray(np.linalg.lstsq(system, target, rcond=None)[0][:, None] * across)


def _group_pieces(
    lines: Sequence[FloatArray], directions: Sequence[FloatArray | None], shifts: FloatArray, spacing_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    from scipy.interpolate import CubicSpline

    left, right = lines[0], lines[-1]
    size = (length_of(left) + length_of(right)) / 2
    share = np.linspace(0.0, 1.0, max(2, round(size / spacing_m) + 1))
    middle = (along(left, share * length_of(left)) + along(right, share * length_of(right))) / 2
    middle = middle + (1 - share)[:, None] * shifts[0] + share[:, None] * shifts[1]
    keep = np.concatenate([[True], np.hypot(*np.diff(middle, axis=0).T) > 1e-6])
    middle = middle[keep]
    chord = arc_lengths(middle)
    natural = (2, np.zeros(2))
    ends = [natural if direction is None else (1, direction) for direction in directions]
    spline = CubicSpline(chord, middle, bc_type=(ends[0], ends[1]))
    u = np.linspace(0.0, chord[-1], max(50, math.ceil(chord[-1] / 0.05)) + 1)
    slope = spline(u, 1)
    heading = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(heading)))])
    effort = turned / _MAX_PIECE_RAD + arc_lengths(spline(u)) / _MAX_PIECE_M
    pieces = max(_MIN_PIECES, math.ceil(effort[-1]))
    at = np.interp(np.linspace(0.0, effort[-1], pieces + 1), effort, u)
    points, slope = spline(at), spline(at, 1)
    tangents = slope / np.hypot(slope[:, 0], slope[:, 1])[:, None]
    return np.concatenate([[0.0], np.cumsum(_sizes(points, tangents))]), points, tangents


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
