"""Smoothing of paths: corners that are too tight are rounded, and points away from them stay."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.smoothing import curvature, drivable

DS_M, AT_M = 0.5, 60.0


def corner(angle: float) -> FloatArray:
    """Return (241, 2) points of a path of 120 m that turns by an angle in its middle."""
    s = DS_M * np.arange(241) - AT_M
    after = np.maximum(s, 0.0)
    return np.column_stack([np.minimum(s, 0.0) + np.cos(angle) * after, np.sin(angle) * after])


@pytest.mark.parametrize("angle", [np.pi / 3, np.pi / 2])
def test_a_corner_is_rounded_and_all_else_stays(angle: float) -> None:
    straight, turning = corner(0.0), corner(angle)
    both = np.stack([turning, straight, turning])
    smooth = drivable(both, np.full(both.shape[:2], 4.0), DS_M)
    assert np.abs(curvature(smooth)).max() < 0.25 < np.abs(curvature(both)).max()
    far = np.abs(DS_M * np.arange(241) - AT_M) > 30.0
    assert np.allclose(smooth[:, far], both[:, far], atol=1e-9)
    assert np.allclose(smooth[1], straight, atol=1e-9)
    assert np.array_equal(smooth[0], smooth[2])  # paths do not see each other


def test_a_corner_in_a_narrow_lane_stays_in_it() -> None:
    turning = corner(np.pi / 2)[None]
    smooth = drivable(turning, np.full(turning.shape[:2], 1.0), DS_M)
    assert np.hypot(*(smooth - turning)[0].T).max() <= 0.95


def test_the_same_paths_are_smoothed_once_and_others_anew() -> None:
    half = np.full((1, 241), 4.0)
    first = drivable(corner(np.pi / 2)[None], half, DS_M)
    assert drivable(corner(np.pi / 2)[None], half.copy(), DS_M) is first
    assert np.abs(drivable(corner(np.pi / 2)[None], half / 8, DS_M) - first).max() > 0.1
