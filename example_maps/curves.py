"""Curves for drawing roads: clothoids, arcs and smooth joins, sampled densely.

All lengths in metres, angles in radians, curvature in 1/m, positive to the left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import FloatArray

SAMPLE_M = 0.25
TURN_RAD = 0.3


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Point with direction and curvature, where curves begin and end."""

    x: float
    y: float
    heading: float
    curvature: float = 0.0

    @property
    def normal(self) -> tuple[float, float]:
        """Unit vector to the left."""
        return -float(np.sin(self.heading)), float(np.cos(self.heading))

    def shifted(self, forward_m: float, left_m: float) -> Pose:
        """Return the pose moved along and across its own direction, without curvature."""
        c, s = float(np.cos(self.heading)), float(np.sin(self.heading))
        return Pose(
            x=self.x + c * forward_m - s * left_m, y=self.y + s * forward_m + c * left_m, heading=self.heading
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Densely sampled curve of N points; headings are not wrapped, ``s`` is the arc length."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    curvature: FloatArray
    s: FloatArray

    @property
    def length(self) -> float:
        """Arc length, m."""
        return float(self.s[-1])

    def pose(self, s: float) -> Pose:
        """Return the pose at arc length ``s``."""
        at = self.at(np.array([s]))
        return Pose(x=at.x[0], y=at.y[0], heading=at.heading[0], curvature=at.curvature[0])

    def at(self, s: FloatArray) -> Curve:
        """Return the curve at other arc lengths, interpolated linearly."""
        x, y, heading, curvature = (
            np.interp(s, self.s, column) for column in (self.x, self.y, self.heading, self.curvature)
        )
        return Curve(x=x, y=y, heading=heading, curvature=curvature, s=s - s[0])

    def part(self, start: float, end: float, bend: float = 0.0) -> Curve:
        """Return the curve between two arc lengths, sampled for drawing.

        Args:
            bend: 1/m by which lines beside the curve bend more than it, as where lanes open.
        """
        kappa = np.interp(np.linspace(start, end, 50), self.s, np.abs(self.curvature))
        return self.at(np.linspace(start, end, stations(end - start, float(kappa.max()) + bend)))

    def offset(self, left_m: FloatArray | float) -> FloatArray:
        """Return points (N, 2) at a lateral distance to the left, which may vary along the curve."""
        d = np.broadcast_to(left_m, self.x.shape)
        return np.column_stack([self.x - np.sin(self.heading) * d, self.y + np.cos(self.heading) * d])


def stations(length_m: float, curvature: float, tolerance_m: float = 0.02) -> int:
    """Return how many points a polyline needs within ``tolerance_m`` of an arc, at most 10 m apart."""
    spacing = np.clip(np.sqrt(8 * tolerance_m / max(abs(curvature), 1e-9)), 1.0, 10.0)
    return max(3, int(np.ceil(length_m / spacing)) + 1)


def clothoids(start: Pose, pieces: Sequence[tuple[float, float, float]]) -> Curve:
    """Make a chain of clothoids; the curvature of ``start`` is not used.

    Args:
        pieces: length, curvature at the start and at the end of each; equal ones make an arc or a line.
    """
    curvature: list[FloatArray] = []
    s: list[FloatArray] = []
    begin = 0.0
    for length, first, last in pieces:
        count = int(np.ceil(length / SAMPLE_M)) + 1
        s.append(begin + np.linspace(0, length, count))
        curvature.append(np.linspace(first, last, count))
        begin += length
    station, kappa = np.concatenate(s), np.concatenate(curvature)
    heading = start.heading + _integral(kappa, station)
    x = start.x + _chord_integral(np.cos, heading, kappa, station)
    y = start.y + _chord_integral(np.sin, heading, kappa, station)
    keep = np.concatenate([[True], np.diff(station) > 1e-9])
    return Curve(x=x[keep], y=y[keep], heading=heading[keep], curvature=kappa[keep], s=station[keep])


def arc(centre: tuple[float, float], radius: float, start: float, end: float) -> Curve:
    """Make an arc counter-clockwise around ``centre`` between two polar angles."""
    angle = np.linspace(start, end, int(np.ceil((end - start) * radius / SAMPLE_M)) + 1)
    return Curve(
        x=centre[0] + radius * np.cos(angle),
        y=centre[1] + radius * np.sin(angle),
        heading=angle + np.pi / 2,
        curvature=np.full(angle.shape, 1 / radius),
        s=(angle - start) * radius,
    )


def join(start: Pose, end: Pose) -> Curve:
    """Make the quintic curve between two poses with the smallest peak of curvature.

    Position and direction match at both ends. Curvature matches too, unless it bends against the turn (into a
    roundabout: right, then left): there the curve ends straight, as roads are built. The lengths of the end
    tangents are chosen on a grid.
    """
    turn = float(np.angle(np.exp(1j * (end.heading - start.heading))))
    if abs(turn) > TURN_RAD:
        start, end = (
            replace(pose, curvature=pose.curvature if pose.curvature * turn > 0 else 0.0)
            for pose in (start, end)
        )
    chord = float(np.hypot(end.x - start.x, end.y - start.y))
    scales = chord * np.arange(0.8, 2.41, 0.1)
    # Mirror images tie up to rounding: the order must not depend on it.
    options = (
        (round(_peak(_quintic(start, end, a, b)), 9), round(abs(a - b), 6), a, b)
        for a in scales
        for b in scales
    )
    _, _, a, b = min(options)
    return _quintic(start, end, a, b, count=int(np.ceil(2 * chord / SAMPLE_M)) + 1)


def smooth_step(s: FloatArray, start: float, end: float) -> FloatArray:
    """Return 0 before ``start``, 1 after ``end``, with continuous slope and curvature between them."""
    u = np.clip((s - start) / (end - start), 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def _integral(value: FloatArray, s: FloatArray) -> FloatArray:
    steps = np.diff(s) * (value[1:] + value[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def _chord_integral(wave: np.ufunc, heading: FloatArray, kappa: FloatArray, s: FloatArray) -> FloatArray:
    # Simpson's rule: the midpoint's heading follows from the curvatures at both ends.
    ds = np.diff(s)
    middle = heading[:-1] + ds * (3 * kappa[:-1] + kappa[1:]) / 8
    steps = ds * (wave(heading[:-1]) + 4 * wave(middle) + wave(heading[1:])) / 6
    return np.concatenate([[0.0], np.cumsum(steps)])


def _quintic(start: Pose, end: Pose, a: float, b: float, count: int = 40) -> Curve:
    u = np.linspace(0.0, 1.0, count)[:, None]
    p0, p1 = np.array([start.x, start.y]), np.array([end.x, end.y])
    t0 = np.array([np.cos(start.heading), np.sin(start.heading)])
    t1 = np.array([np.cos(end.heading), np.sin(end.heading)])
    d0, d1 = a * t0, b * t1
    e0 = a**2 * start.curvature * np.array(start.normal)
    e1 = b**2 * end.curvature * np.array(end.normal)
    c3 = 10 * (p1 - p0) - 6 * d0 - 4 * d1 - 1.5 * e0 + 0.5 * e1
    c4 = -15 * (p1 - p0) + 8 * d0 + 7 * d1 + 1.5 * e0 - e1
    c5 = 6 * (p1 - p0) - 3 * d0 - 3 * d1 - 0.5 * e0 + 0.5 * e1
    p = p0 + d0 * u + e0 * u**2 / 2 + c3 * u**3 + c4 * u**4 + c5 * u**5
    v = d0 + e0 * u + 3 * c3 * u**2 + 4 * c4 * u**3 + 5 * c5 * u**4
    w = e0 + 6 * c3 * u + 12 * c4 * u**2 + 20 * c5 * u**3
    speed = np.hypot(v[:, 0], v[:, 1])
    curvature = (v[:, 0] * w[:, 1] - v[:, 1] * w[:, 0]) / np.maximum(speed, 1e-9) ** 3
    s = _integral(speed, u[:, 0])
    heading = np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
    return Curve(x=p[:, 0], y=p[:, 1], heading=heading, curvature=curvature, s=s)


def _peak(curve: Curve) -> float:
    return float(np.abs(curve.curvature).max())
