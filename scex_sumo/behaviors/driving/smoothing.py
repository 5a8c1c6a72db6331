"""Path smoothing: a Gaussian filter, then rounding of corners that are too tight for a car."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import along, length_of

BASE_SIGMA_M = 1.5  # a turn of 8 m radius moves inwards by 0.14 m
CURVATURES = (0.33, 0.25, 0.195, 0.165)  # 1/m, tried in this order; the last leaves room to correct
SWEEPS = 400  # a right angle needs about 375 at 0.2 1/m
SWEEPS_AT_ONCE = 10
ENOUGH = 0.02  # part of a bend above the limit
FREEZE_M = 15.0


def drivable(points: FloatArray, half_width: FloatArray, ds: float) -> FloatArray:
    """Smooth paths of evenly spaced points.

    Args:
        half_width: (K, N) of the lane, m; no point moves further than 0.95 of it.

    Returns:
        (K, N, 2) m, with the smallest limit of `CURVATURES` that keeps the path in the lane; read-only.
    """
    return _drivable(points.tobytes(), half_width.tobytes(), points.shape, ds)


@lru_cache(maxsize=1)  # a scene and the same scene with estimated headings have the same paths
def _drivable(raw: bytes, widths: bytes, shape: tuple[int, ...], ds: float) -> FloatArray:
    points = np.frombuffer(raw).reshape(shape)
    bound = 0.95 * np.frombuffer(widths).reshape(shape[:2])
    smooth = _within(gaussian(points, BASE_SIGMA_M / ds), points, bound)
    for limit in CURVATURES:
        rows = np.flatnonzero((np.abs(curvature(smooth)) > 1.02 * limit).any(axis=1))
        if not len(rows):
            continue
        wider = _relaxed(smooth[rows], limit)
        shift = wider - points[rows]
        too_far = np.hypot(shift[..., 0], shift[..., 1]) > bound[rows]
        # Where the curve would leave its lane, keep the previous one; only tight places have changed.
        stays = _dilate(too_far, int(FREEZE_M / ds))
        smooth[rows] = np.where(stays[..., None], smooth[rows], wider)
    smooth.flags.writeable = False
    return smooth


def _relaxed(points: FloatArray, limit: float) -> FloatArray:
    """Move points with too tight a bend towards the middle of both neighbours, until few are left."""
    tight = np.flatnonzero((np.abs(curvature(points)) > limit).any(axis=0))
    window = slice(max(0, tight[0] - 80), tight[-1] + 81)
    moved = points.copy()
    inner = np.ones(moved[:, window].shape[:2], dtype=np.bool_)
    inner[:, [0, -1]] = False
    xy, moving = moved[:, window].reshape(-1, 2).T.copy(), inner.copy()
    for _ in range(SWEEPS // SWEEPS_AT_ONCE):
        # One sweep spreads the motion by one point.
        at = np.flatnonzero(_dilate(moving, SWEEPS_AT_ONCE + 1))
        beside = np.diff(at) == 1
        xy[:, at], excess = _swept(xy[:, at], limit, inner.ravel()[at[1:-1]] & beside[1:] & beside[:-1])
        if excess.max() < ENOUGH:
            break
        moving = np.zeros_like(inner)
        moving.ravel()[at[1:-1]] = excess > 0
    moved[:, window] = xy.T.reshape(*inner.shape, 2)
    return moved


def _swept(xy: FloatArray, limit: float, free: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return points (2, n) moved by `SWEEPS_AT_ONCE` sweeps, and the last excess (n - 2,) of their bends.

    ``free`` (n - 2,): points that may move, all but the first and the last.
    """
    eight, excess = 8.0 * free, np.zeros(free.size)
    for _ in range(SWEEPS_AT_ONCE):
        away = 0.5 * (xy[:, :-2] + xy[:, 2:]) - xy[:, 1:-1]
        distance, chord = away**2, (xy[:, 2:] - xy[:, :-2]) ** 2
        bend = eight * np.sqrt(distance[0] + distance[1]) / np.maximum(chord[0] + chord[1], 4e-6)
        excess = 1 - limit / np.maximum(bend, limit)
        if np.maximum.reduce(excess) < ENOUGH:
            break
        xy[:, 1:-1] += 0.9 * excess * away
    return xy, excess


def gaussian(values: FloatArray, sigma: float) -> FloatArray:
    """Filter axis 1 of (K, N, F), `sigma` in samples; the ends go on straight."""
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
    """Return (K, N) curvatures of paths (K, N, 2), 1/m, left positive."""
    first = np.gradient(points, axis=1)
    second = np.gradient(first, axis=1)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    speed = np.hypot(first[..., 0], first[..., 1])
    return np.asarray(cross / np.maximum(speed, 1e-6) ** 3)


def _within(moved: FloatArray, points: FloatArray, bound: FloatArray) -> FloatArray:
    shift = moved - points
    size = np.hypot(shift[..., 0], shift[..., 1]) / bound
    # x / (1 + x^8)^(1/8) is x for small x and 1 for large x.
    return np.asarray(points + shift / (1 + np.minimum(size, 1e6)[..., None] ** 8) ** 0.125)


def _dilate(mask: BoolArray, reach: int) -> BoolArray:
    n = mask.shape[1]
    total = np.cumsum(np.pad(mask, ((0, 0), (reach + 1, reach))), axis=1)
    return np.asarray(total[:, 2 * reach + 1 :] > total[:, :n])


def resample(points: FloatArray, count: int, ds: float, first_s: float = 0.0) -> FloatArray:
    """Return (count, 2) points of a polyline every `ds` from `first_s` on, straight on past its end."""
    s: FloatArray = first_s + ds * np.arange(count, dtype=np.float64)
    past = np.maximum(s - length_of(points), 0.0)
    tail = points[-1] - points[-2]
    tail = tail / max(float(np.hypot(*tail)), 1e-9)
    return np.asarray(along(points, s) + past[:, None] * tail)
