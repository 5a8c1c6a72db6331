"""Smoothing of recorded positions, and their velocities."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError

JERK_DENSITY = 0.25  # power spectral density of a road user's jerk, m²/s⁵
MIN_STEP_S = 1e-6
_HUBER = 2.5  # residuals beyond this many sigmas count linearly


def smooth(points: FloatArray, time_s: FloatArray, segment: IntArray, noise_m: float) -> FloatArray:
    """Smooth positions (N, 2) as a constant-acceleration Kalman (RTS) smoother does, m.

    The result minimises sum |z - p|² + lambda integral |p'''|² dt with lambda = noise² / jerk density: a
    banded linear system for all tracks at once (Whittaker 1923), with Huber weights in three iterations.

    Args:
        segment: (N,) number of the piece; pieces under four rows stay.
        noise_m: standard deviation of the noise per axis, m.
    """
    from scipy.linalg import LinAlgError, solveh_banded

    if len(points) < 4 or noise_m <= 0.0:
        return points.copy()
    least = np.diff(time_s)[np.diff(segment) == 0].min(initial=np.inf)
    close = TrackError(f"samples of a track {least:.2g} s apart: too close to smooth; leave the copies out")
    if least < MIN_STEP_S:
        raise close
    bands = _penalty(time_s, segment) * noise_m**2 / JERK_DENSITY
    weight = np.ones(len(points))
    smoothed = points
    for _ in range(3):
        system = bands.copy()
        system[0] += weight
        try:
            smoothed = solveh_banded(system, points * weight[:, None], lower=True)
        except LinAlgError:
            raise close from None
        residual = np.hypot(*(points - smoothed).T)
        weight = np.minimum(1.0, _HUBER * noise_m / np.maximum(residual, 1e-12))
    return np.asarray(smoothed)


def _penalty(time_s: FloatArray, segment: IntArray) -> NDArray[Any]:
    size = len(time_s)
    windows = size - 3
    inside = segment[3:] == segment[:-3]
    coefficients = np.zeros((4, windows))
    for j in range(4):
        product = np.ones(windows)
        for i in range(4):
            if i != j:
                gap = time_s[j : windows + j] - time_s[i : windows + i]
                product = product * np.where(inside, gap, 1.0)
        # third derivative of the cubic through four points (divided difference times 3!)
        coefficients[j] = np.where(inside, 6.0 / product, 0.0)
    span = np.where(inside, (time_s[3:] - time_s[:-3]) / 3.0, 0.0)
    bands = np.zeros((4, size))
    for a in range(4):
        for b in range(a, 4):
            bands[b - a, a : windows + a] += coefficients[a] * coefficients[b] * span
    return bands


def derivative(points: FloatArray, time_s: FloatArray, segment: IntArray) -> FloatArray:
    """Return velocities (N, 2) in m/s from positions, of second order; 0 for a segment of one row."""
    joined = segment[1:] == segment[:-1]
    step = np.where(joined, np.diff(time_s), 1.0)[:, None]
    slope = np.where(joined[:, None], np.diff(points, axis=0) / step, 0.0)
    before: BoolArray = np.append(False, joined)
    after: BoolArray = np.append(joined, False)
    h0, h1 = np.vstack(([[1.0]], step)), np.vstack((step, [[1.0]]))
    s0, s1 = np.vstack((np.zeros((1, 2)), slope)), np.vstack((slope, np.zeros((1, 2))))
    both = (before & after)[:, None]
    velocity: FloatArray
    velocity = np.where(both, (h1 * s0 + h0 * s1) / (h0 + h1), np.where(after[:, None], s1, s0))
    # ends: extrapolate the parabola through three samples
    first = np.flatnonzero(~before[:-1] & after[:-1] & after[1:])
    last = np.flatnonzero(before[1:] & ~after[1:] & before[:-1]) + 1
    for end, neighbour, slopes in ((first, first + 1, s1), (last, last - 1, s0)):
        velocity[end] = 2.0 * slopes[end] - velocity[neighbour]
    return velocity
