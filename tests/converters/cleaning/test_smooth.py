"""Smoothing keeps motion and removes noise."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.cleaning.smoothing import JERK_DENSITY, smooth

UNEVEN = np.cumsum(np.random.default_rng(1).uniform(0.05, 0.2, 40))


def _parabola(t: FloatArray) -> FloatArray:
    return np.stack((3.0 + 8.0 * t + 1.5 * t**2, -2.0 * t + 0.5 * t**2), axis=1)


def test_constant_acceleration_passes_unchanged_at_uneven_times() -> None:
    segment = np.zeros(40, np.int64)
    points = _parabola(UNEVEN)
    # banded solve of a system with condition number near 1e9: nine digits are lost
    np.testing.assert_allclose(smooth(points, UNEVEN, segment, 0.2), points, atol=1e-6)


def _kalman_rts(z: FloatArray, step_s: float, noise_m: float, jerk_density: float) -> FloatArray:
    """Textbook constant-acceleration Kalman filter and Rauch-Tung-Striebel smoother in one dimension."""
    d = step_s
    transition = np.array([[1, d, d**2 / 2], [0, 1, d], [0, 0, 1]])
    process = jerk_density * np.array(
        [[d**5 / 20, d**4 / 8, d**3 / 6], [d**4 / 8, d**3 / 3, d**2 / 2], [d**3 / 6, d**2 / 2, d]]
    )
    mean, spread = np.array([z[0], 0.0, 0.0]), np.diag([1e4, 1e4, 1e4])
    filtered, predicted = [], []
    for k, value in enumerate(z):
        if k:
            mean, spread = transition @ mean, transition @ spread @ transition.T + process
        predicted.append((mean, spread))
        gain = spread[:, 0] / (spread[0, 0] + noise_m**2)
        mean, spread = mean + gain * (value - mean[0]), spread - np.outer(gain, spread[0])
        filtered.append((mean, spread))
    result = [filtered[-1][0]]
    for k in range(len(z) - 2, -1, -1):
        mean, spread = filtered[k]
        backward = spread @ transition.T @ np.linalg.inv(predicted[k + 1][1])
        result.append(mean + backward @ (result[-1] - predicted[k + 1][0]))
    return np.array([state[0] for state in reversed(result)])


def test_it_is_the_kalman_smoother_of_constant_acceleration() -> None:
    rng = np.random.default_rng(3)
    time_s = np.arange(120) * 0.1
    clean = 10.0 * time_s + 2.0 * np.sin(time_s)
    # noise cut at 2 sigma, so that no sample is weighted down
    noisy = clean + 0.1 * np.clip(rng.standard_normal(120), -2, 2)
    points = np.stack((noisy, np.zeros(120)), axis=1)
    ours = smooth(points, time_s, np.zeros(120, np.int64), 0.1)[:, 0]
    theirs = _kalman_rts(noisy, 0.1, 0.1, JERK_DENSITY)
    # Ours has the integral of the jerk as a sum: they differ by far less than the noise that remains.
    assert np.abs(ours - theirs).max() < 0.015
    assert np.std(theirs - clean) > 0.02
