"""Paths that a car can drive, out of centrelines as maps have them.

Centrelines have corners (up to 89 degrees), steps and uneven points. A path is the centreline under a
Gaussian, wider where the curve would still be too tight, and never far from the original.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.lines import arc_lengths
from scex_sumo.scene import BoolArray, FloatArray

BASE_SIGMA_M = 1.5  # a turn of 8 m radius moves inwards by 0.14 m
WIDER_SIGMA_M = (2.5, 3.5, 5.0)  # 3.5 m takes a corner of 89 degrees at 0.18 1/m
TIGHTEST = 0.17  # 1/m; leaves a driver 0.03 1/m to correct with


def drivable(points: FloatArray, half_width: FloatArray, ds: float) -> FloatArray:
    """Smooth paths of evenly spaced points.

    Args:
        points: (K, N, 2) m, spaced by about `ds`.
        half_width: (K, N) half the lane's width, m; no point moves further than 0.8 of it.
        ds: spacing, m.

    Returns:
        (K, N, 2) m. Curvature is at most `TIGHTEST` wherever the lane is wide enough for that.
    """
    smooth = _within(gaussian(points, BASE_SIGMA_M / ds), points, half_width)
    for sigma in WIDER_SIGMA_M:
        tight = np.abs(curvature(smooth)) > TIGHTEST
        rows = np.flatnonzero(tight.any(axis=1))
        if not len(rows):
            break
        reach = int(2 * sigma / ds)
        near = _dilate(tight[rows], reach).astype(np.float64)
        weight = gaussian(near[:, :, None], sigma / 2 / ds)
        wider = gaussian(points[rows], sigma / ds)
        mixed = smooth[rows] + weight * (wider - smooth[rows])
        smooth[rows] = _within(mixed, points[rows], half_width[rows])
    return smooth


def gaussian(values: FloatArray, sigma: float) -> FloatArray:
    """Gaussian filter along axis 1 of (K, N, F); the ends go on straight.

    Args:
        values: (K, N, F).
        sigma: in samples.
    """
    reach = max(1, int(np.ceil(3 * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    before = 2 * values[:, :1] - values[:, reach:0:-1]
    after = 2 * values[:, -1:] - values[:, -2 : -reach - 2 : -1]
    wide = np.concatenate([before, values, after], axis=1)
    n = values.shape[1]
    result: FloatArray = kernel[reach] * values
    for i in range(reach):  # symmetric taps together
        result += kernel[i] * (wide[:, i : i + n] + wide[:, 2 * reach - i : 2 * reach - i + n])
    return result


def curvature(points: FloatArray) -> FloatArray:
    """(K, N) curvature of paths (K, N, 2) by central differences, 1/m, left positive."""
    first = np.gradient(points, axis=1)
    second = np.gradient(first, axis=1)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    speed = np.hypot(first[..., 0], first[..., 1])
    result: FloatArray = cross / np.maximum(speed, 1e-6) ** 3
    return result


def _within(moved: FloatArray, points: FloatArray, half_width: FloatArray) -> FloatArray:
    """Points drawn back to 0.8 of the half width from where they were; softly, so that no corner arises."""
    shift = moved - points
    size = np.hypot(shift[..., 0], shift[..., 1]) / (0.8 * half_width)
    # x / (1 + x^8)^(1/8) is x for small x and 1 for large x.
    drawn: FloatArray = points + shift / (1 + np.minimum(size, 1e6)[..., None] ** 8) ** 0.125
    return drawn


def _dilate(mask: BoolArray, reach: int) -> FloatArray:
    """(K, N) 1 within `reach` samples of a True."""
    n = mask.shape[1]
    total = np.cumsum(np.pad(mask, ((0, 0), (reach + 1, reach))), axis=1)
    near: BoolArray = total[:, 2 * reach + 1 :] > total[:, :n]
    return near.astype(np.float64)


def resample(points: FloatArray, count: int, ds: float, first_s: float = 0.0) -> FloatArray:
    """(count, 2) points of a polyline every `ds` from `first_s` on, straight on past its end."""
    arc = arc_lengths(points)
    s = first_s + ds * np.arange(count)
    x = np.interp(s, arc, points[:, 0])
    y = np.interp(s, arc, points[:, 1])
    past = np.maximum(s - arc[-1], 0.0)
    tail = points[-1] - points[-2]
    tail = tail / max(float(np.hypot(*tail)), 1e-9)
    return np.column_stack([x + past * tail[0], y + past * tail[1]])
