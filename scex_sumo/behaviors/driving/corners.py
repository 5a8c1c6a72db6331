"""Corners of paths that are too tight for a car, rounded where the lanes leave room."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import curvature

SWEEPS = 400  # a right angle needs about 375 at 0.2 1/m
SWEEPS_AT_ONCE = 10
ENOUGH = 0.02  # part of a bend above the limit
FREEZE_M = 15.0


def rounded(smooth: FloatArray, points: FloatArray, bound: FloatArray, limit: float, ds: float) -> FloatArray:
    """Return paths (K, N, 2) of points every ``ds`` m with bends up to a limit, 1/m, where they may move.

    ``bound``: (K, N) farthest from ``points`` (K, N, 2), m; where the curve would leave its lane, it stays.
    """
    wider = _relaxed(smooth, limit)
    shift = wider - points
    too_far = np.hypot(shift[..., 0], shift[..., 1]) > bound
    # Only tight places have changed.
    stays = _dilate(too_far, int(FREEZE_M / ds))
    return np.where(stays[..., None], smooth, wider)


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
        index = np.flatnonzero(_dilate(moving, SWEEPS_AT_ONCE + 1))
        beside = np.diff(index) == 1
        xy[:, index], excess = _swept(
            xy[:, index], limit, inner.ravel()[index[1:-1]] & beside[1:] & beside[:-1]
        )
        if excess.max() < ENOUGH:
            break
        moving = np.zeros_like(inner)
        moving.ravel()[index[1:-1]] = excess > 0
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


def _dilate(mask: BoolArray, reach: int) -> BoolArray:
    n = mask.shape[1]
    total = np.cumsum(np.pad(mask, ((0, 0), (reach + 1, reach))), axis=1)
    return np.asarray(total[:, 2 * reach + 1 :] > total[:, :n])
