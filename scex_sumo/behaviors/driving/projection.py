"""Projection of points onto paths."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, least_of
from scex_sumo.behaviors.driving.paths import BEHIND_M, COARSE, DS_M, SeedPaths
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, SceneHistory, VehicleIndex

POINTS_AT_ONCE = 1 << 10  # their distances to all samples fit the processor's cache
LAP_WEIGHT = 0.01  # (m off the path)² per (m off the expected arc length)²
OTHER_PATH = 1.0  # a vehicle is on another path if that fits better than the straightest by this
OFFSET_SIGMA_M, HEADING_SIGMA_RAD = 0.8, 0.15


def clipped(values: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray:
    """Return ``np.clip``, without its overhead for small arrays."""
    result: FloatArray = np.minimum(np.maximum(values, low), high)
    return result


def sample_paths(paths: SeedPaths, row: IntArray, s: FloatArray) -> FloatArray:
    """Return (6, n) `COLUMNS` at arc lengths `s`: linear between samples, straight on past both ends."""
    position = s * (1 / DS_M)
    index = clipped(position, 0.0, paths.samples - 1.0).astype(np.int64)
    values = np.ascontiguousarray(paths.table.take(row * paths.samples + index, axis=0).T)
    inner: FloatArray = values[:6] + values[6:] * (position - index)
    return inner


def bend_at(paths: SeedPaths, row: IntArray, s: FloatArray) -> FloatArray:
    """Return (n,) curvatures at arc lengths, 1/m."""
    position = clipped(s * (1 / DS_M), 0.0, paths.samples - 1.0)
    index = position.astype(np.int64)
    at = row * paths.samples + index
    bend: FloatArray = paths.bend[0].take(at) + paths.bend[1].take(at) * (position - index)
    return bend


def refine(
    paths: SeedPaths, row: IntArray, s: FloatArray, x: FloatArray, y: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move first guesses of arc lengths to the foot points.

    Returns:
        (n,) arc length, m; (n,) distance, m, left positive; (n,) heading of the path, unwrapped.
    """
    for _ in range(steps):
        px, py, cos, sin, heading, curvature = sample_paths(paths, row, s)
        dx, dy = x - px, y - py
        ahead = cos * dx + sin * dy
        offset = cos * dy - sin * dx
        # Newton; the bound keeps it on this branch where the path bends around the point.
        step = ahead / np.maximum(1 - curvature * offset, 0.3)
        s = s + clipped(step, -COARSE * DS_M, COARSE * DS_M)
    px, py, cos, sin, heading, _ = sample_paths(paths, row, s)
    return s, cos * (y - py) - sin * (x - px), heading


def expected_way(history: SceneHistory, who: VehicleIndex) -> FloatArray:
    """Return (n,) rough arc lengths, m, from the mean of first and present speed, to distinguish laps."""
    first = history.scene.now.speed[who.vehicle]
    now = history.now.speed[who.future, who.vehicle]
    return BEHIND_M + history.step * STEP_S * (first + now) / 2


def foot_points(
    paths: SeedPaths, row: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Project points onto their paths; see `refine` for the result.

    Args:
        expected: (n,) rough arc length, m, which decides where a path passes a place twice.
    """
    first = np.empty(len(row))
    for start in range(0, len(row), POINTS_AT_ONCE):
        part = slice(start, start + POINTS_AT_ONCE)
        nearest = _nearest_sample(paths, row[part], x[part], y[part], expected[part])
        first[part] = nearest * (COARSE * DS_M)
    return refine(paths, row, first, x, y, 4)


def path_positions(
    history: SceneHistory, who: VehicleIndex, paths: SeedPaths, row: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where vehicles are now on rows of paths.

    Returns:
        (n,) arc length of the centre, m; (n,) distance from the path, m, left positive; (n,) heading of the
        path there, rad, unwrapped.

    Example:
        >>> history = scex.SceneHistory.of_scene(scex.read_seed(scex.example_path("roundabout")))
        >>> who = scex.VehicleIndex(future=np.array([0]), vehicle=np.array([3]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, who, "straight")
        >>> s, offset, heading = scex.path_positions(history, who, paths, row)
        >>> s.shape, bool(abs(offset[0]) < 2.0)
        ((1,), True)
    """
    now = history.now[who.future, who.vehicle]
    return foot_points(paths, row, now.x, now.y, expected_way(history, who))


def nearest_paths(
    paths: SeedPaths,
    straight: IntArray,
    vehicle: IntArray,
    way: FloatArray,
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
) -> tuple[IntArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """Return rows (n,) of the paths that vehicles are on, the straightest in doubt, and `foot_points`."""
    row = straight.copy()
    feet = foot_points(paths, row, x, y, way)
    best = _misfit(feet, heading)
    doubt = np.flatnonzero((best > OTHER_PATH) & (paths.count[vehicle] > 1))
    if not len(doubt):
        return row, feet
    count = paths.count[vehicle[doubt]]
    i = np.repeat(doubt, count)
    candidate = np.repeat(paths.first[vehicle[doubt]] - (np.cumsum(count) - count), count) + np.arange(len(i))
    others = foot_points(paths, candidate, x[i], y[i], way[i])
    misfit = _misfit(others, heading[i])
    chosen = least_of(i, misfit, candidate)
    chosen = chosen[misfit[chosen] < best[i[chosen]] - OTHER_PATH]
    row[i[chosen]] = candidate[chosen]
    for values, better in zip(feet, others, strict=True):
        values[i[chosen]] = better[chosen]
    return row, feet


def _misfit(feet: tuple[FloatArray, FloatArray, FloatArray], heading: FloatArray) -> FloatArray:
    _, offset, path_heading = feet
    error = wrap(heading - path_heading)
    misfit: FloatArray = (offset / OFFSET_SIGMA_M) ** 2 + (error / HEADING_SIGMA_RAD) ** 2
    return misfit


def _nearest_sample(
    paths: SeedPaths, row: IntArray, x: FloatArray, y: FloatArray, expected: FloatArray
) -> IntArray:
    coarse = paths.coarse.take(row, axis=0)
    dx, dy = (x - paths.centre[0])[:, None], (y - paths.centre[1])[:, None]
    square = coarse[:, 0] * dx
    square += coarse[:, 1] * dy
    square += coarse[:, 2]
    # Two laps of a roundabout differ by centimetres in distance and some 50 m in arc length.
    off = COARSE * DS_M * np.arange(coarse.shape[2]) - expected[:, None]
    off *= off
    off *= LAP_WEIGHT
    square += off
    nearest: IntArray = np.argmin(square, axis=1)
    return nearest
