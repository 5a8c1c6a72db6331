"""Targets: a vehicle's recorded future along its path."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths
from scex_sumo.scene import States

AMBIGUOUS_M = 0.3  # two paths this near over the recorded future are both right
RETURN_S = 2.5  # for the way back to where the recorded driver drove
RETURN_M = 12.0  # shortest way for it: a standing vehicle does not move sideways


def along_paths(
    paths: SeedPaths, path: IntArray, start: States, future: States, start_way: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return arc lengths and offsets of states from paths (n,): (n,), (n,) now; (n, F), (n, F) later.

    ``start_way``: (n,) rough arc length at present, m.
    """
    n, steps = future.x.shape
    s0, d0, _ = paths.foot_points(path, start.x, start.y, start_way)
    step_x = np.diff(np.concatenate([start.x[:, None], future.x], 1), axis=1)
    step_y = np.diff(np.concatenate([start.y[:, None], future.y], 1), axis=1)
    expected = s0[:, None] + np.cumsum(np.hypot(step_x, step_y), axis=1)
    s, d, _ = paths.foot_points(np.repeat(path, steps), future.x.ravel(), future.y.ravel(), expected.ravel())
    return s0, d0, s.reshape(n, steps), d.reshape(n, steps)


def right_paths(
    paths: SeedPaths, vehicle: IntArray, now: States, future: States, valid: BoolArray
) -> tuple[IntArray, IntArray, BoolArray]:
    """Find the candidate paths that vehicles took.

    Args:
        vehicle: (k,) vehicles with a recorded future.
        future: (k, F), as long as recorded, because the time after the plan decides between forks.

    Returns:
        (r,) rows of all their candidate paths, (r,) index into `vehicle` of each, and (r,) True for the one
        nearest to the future on average, and for those within `AMBIGUOUS_M` of it.
    """
    count = paths.count[vehicle]
    owner = np.repeat(np.arange(len(vehicle)), count)
    first = np.cumsum(count) - count
    path = paths.first[vehicle][owner] + np.arange(len(owner)) - first[owner]
    if not len(path):
        return path, owner, np.zeros(0, dtype=np.bool_)
    _, _, _, d = along_paths(paths, path, now[owner], future[owner], np.full(len(path), BEHIND_M))
    known = valid[owner]
    distance = (np.abs(d) * known).sum(1) / np.maximum(known.sum(1), 1)
    best = np.minimum.reduceat(distance, first)
    return path, owner, distance <= best[owner] + AMBIGUOUS_M


def smooth_return(
    displaced: FloatArray, slope: FloatArray, speed: FloatArray, travelled_m: FloatArray
) -> FloatArray:
    """Return (n, H) m that a displaced vehicle is still off the recorded one on its way back.

    A quintic in the distance travelled ``travelled_m`` (n, H) m, to zero without slope and curvature.
    ``slope`` (n,) is the tangent of the heading error.
    """
    length = np.maximum(RETURN_M, RETURN_S * speed)[:, None]
    keep, lean = fading(np.clip(travelled_m / length, 0.0, 1.0))
    return np.asarray(displaced[:, None] * keep + slope[:, None] * length * lean)


def fading(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return quintics on [0, 1] to a flat 0: from 1, and from 0 with unit slope."""
    return 1 - u**3 * (10 - 15 * u + 6 * u**2), u - u**3 * (6 - 8 * u + 3 * u**2)
