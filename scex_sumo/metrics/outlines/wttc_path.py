"""Worst time to collision of outlines: rectangles that keep their headings, not the circles around them.

The first t at which the distance of the rectangles, each moved on by its present velocity, is ½ A t². The
distance is a convex function of t: the plane through the nearest point of the outlines bounds it from below
for all times, and its meeting with the parabola is a time that is never late. From there again, the times
come to the first contact from the left; where a side is nearest, in one step.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.pairs.gap import MARGIN, in_chunks, outline_pairs, samples_of
from scex_sumo.metrics.pairs.moving import OutlinePairs
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

MAX_ITERATIONS = 100
TOLERANCE_S = 1e-12


def worst_time_of_outlines(pairs: OutlinePairs, acceleration: FloatArray) -> FloatArray:
    """Smallest t >= 0 at which two outlines are no farther apart than ½ A t².

    Args:
        pairs: outlines and velocities.
        acceleration: (N,) A, sum of the largest accelerations of both, m/s².

    Returns:
        (N,) s; 0 on overlap, inf only where the acceleration is 0 and the outlines never touch.

    Source: Wachenfeld et al. 2016, with outlines in the place of circles.
    """
    time = np.zeros(pairs.dx.shape)
    active = np.arange(time.size)
    for _ in range(MAX_ITERATIONS):
        distance, slope = pairs.nearest(time[active])
        now, limit = time[active], acceleration[active]
        spare = distance - 0.5 * limit * now * now
        step = plane_meets_parabola(spare, slope - limit * now, limit)
        going = (distance > 0) & (spare > 0) & (step > TOLERANCE_S)
        time[active] = np.where(going, now + step, now)
        keep = np.flatnonzero(going & np.isfinite(step))
        if keep.size == 0:
            break
        if keep.size < active.size:
            active, pairs = active[keep], pairs.take(keep)
    return time


def plane_meets_parabola(spare: FloatArray, slope: FloatArray, limit: FloatArray) -> FloatArray:
    """Positive root s of spare + slope s = ½ A s²; inf where there is none (A = 0, not closing)."""
    root = np.sqrt(np.maximum(slope * slope + 2 * limit * spare, 0.0))
    closing = root - slope
    with np.errstate(divide="ignore", invalid="ignore"):
        # Two forms of the same root, each free of cancellation on its side of slope = 0.
        step = np.where(slope < 0, 2 * spare / closing, (root + slope) / limit)
    return np.where((limit == 0) & (slope >= 0), np.inf, step)


def wttc_path(scenes: Scenes) -> Samples:
    """WTTC of the outlines of all pairs, s.

    Returns:
        (P, C, T) of unordered pairs. Smaller is more critical.
    """
    pair, scene = np.divmod(np.arange(scenes.distance.size), max(int(np.prod(scenes.shape)), 1))
    times = scenes.at_pairs(worst_times_of, pair, scene)
    return scenes.unordered(times.reshape(scenes.distance.shape))


def worst_times_of(scenes: Scenes, pair: IntArray, scene: IntArray) -> FloatArray:
    """(N,) WTTC of the outlines of pairs in scenes given by flat index into (C, T), s."""
    limit = largest_accelerations(scenes)

    def some(pair: IntArray, scene: IntArray) -> FloatArray:
        one, two = (side[pair] for side in scenes.pairs)
        both = scenes.size_of(limit, one, scene) + scenes.size_of(limit, two, scene)
        return worst_time_of_outlines(outline_pairs(scenes, pair, scene), both)

    return in_chunks(pair, scene, some)


def largest_accelerations(scenes: Scenes) -> FloatArray:
    """(V, C or 1, 1) m/s²."""
    limit = scenes.parameters.accelerations(scenes.tracks.types, scenes.vehicles)
    return np.atleast_2d(limit).T[:, :, None]


def least_wttc_path(scenes: Scenes) -> Samples:
    """WTTC, as `wttc_path` gives them, of the pairs that can have the shortest of their scene.

    Along the line of the centres the outlines come no faster together than their extents along it, which
    bounds the time from below. The pair that is fastest by that bound is evaluated first; only pairs whose
    bound is below its time can be faster.
    """
    least = scenes.of_pairs(_earliest)
    if not least.size:
        return scenes.unordered(least)
    scene = np.arange(int(np.prod(scenes.shape)))
    likely = least.argmin(axis=0).reshape(-1)
    first = scenes.at_pairs(worst_times_of, likely, scene)
    bound = np.where(scenes.both_present.any(axis=0).reshape(-1), first, -1.0)
    close: BoolArray = scenes.both_present & (least <= bound.reshape(scenes.shape) + MARGIN)
    return samples_of(scenes, close, worst_times_of)


def _earliest(scenes: Scenes) -> FloatArray:
    """(P, C, T) s, a bound from below; inf where one is absent."""
    first, second = scenes.pairs
    apart = np.where(scenes.distance > 0, scenes.distance, 1.0)
    nx, ny = scenes.dx / apart, scenes.dy / apart
    near, closing = scenes.distance.copy(), np.zeros(nx.shape)
    for side, sign in ((first, -1.0), (second, 1.0)):
        along = nx * scenes.cos[side] + ny * scenes.sin[side]
        across = ny * scenes.cos[side] - nx * scenes.sin[side]
        near -= scenes.length[side] / 2 * np.abs(along) + scenes.width[side] / 2 * np.abs(across)
        closing += sign * along * scenes.speed[side]
    limit = largest_accelerations(scenes)
    both = np.broadcast_to(limit[first] + limit[second], near.shape)
    least = plane_meets_parabola(np.maximum(near, 0.0), closing, both)
    return np.where(scenes.both_present, np.where(near > 0, least, 0.0), np.inf)
