"""Smoothing of recorded positions, and the velocities that belong to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError

# Power spectral density of a road user's jerk, m²/s⁵.
JERK_DENSITY = 0.25
MIN_STEP_S = 1e-6
_HUBER = 2.5  # residuals beyond this many sigmas count linearly


def position_noise(points: FloatArray, time_s: FloatArray, segment: IntArray) -> float:
    """Estimate the standard deviation of white noise in the positions of moving tracks, per axis in m.

    The variance of third differences is 20 times that of white noise. The largest 2 % are left out as jumps.
    0 with too few samples.

    Args:
        segment: (N,) number of the piece of a track, rows in order of time.
    """
    if len(points) < 4:
        return 0.0
    step = np.diff(time_s)
    even = np.abs(step - np.median(step)) < 0.1 * np.median(step)
    inside = (segment[3:] == segment[:-3]) & even[2:] & even[1:-1] & even[:-2]
    moved = np.hypot(*(points[3:] - points[:-3]).T) > 1.0 * (time_s[3:] - time_s[:-3])
    third = np.diff(points, n=3, axis=0)[inside & moved]
    if len(third) < 10:
        return 0.0
    power = np.sort(np.sum(third**2, axis=1))
    return float(np.sqrt(np.mean(power[: max(1, int(0.98 * len(power)))]) / 40.0))


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
    size = len(points)
    velocity = np.zeros((size, 2))
    if size < 2:
        return velocity
    joined = segment[1:] == segment[:-1]
    step = np.where(joined, np.diff(time_s), 1.0)[:, None]
    slope = np.where(joined[:, None], np.diff(points, axis=0) / step, 0.0)
    before: BoolArray = np.append(False, joined)
    after: BoolArray = np.append(joined, False)
    h0 = np.vstack((np.ones((1, 2)), np.repeat(step, 2, axis=1)))
    h1 = np.vstack((np.repeat(step, 2, axis=1), np.ones((1, 2))))
    s0 = np.vstack((np.zeros((1, 2)), slope))
    s1 = np.vstack((slope, np.zeros((1, 2))))
    both = (before & after)[:, None]
    velocity = np.where(both, (h1 * s0 + h0 * s1) / (h0 + h1), np.where(after[:, None], s1, s0))
    # ends: extrapolate the parabola through three samples
    first = np.flatnonzero(~before[:-1] & after[:-1] & after[1:])
    last = np.flatnonzero(before[1:] & ~after[1:] & before[:-1]) + 1
    for row, neighbour, ends in ((first, first + 1, s1), (last, last - 1, s0)):
        velocity[row] = 2.0 * ends[row] - velocity[neighbour]
    return velocity
