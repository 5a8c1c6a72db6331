"""Body gap: the distance between the outlines of two vehicles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.rectangles import distance_apart
from scex_sumo.metrics.pairs.moving import OutlinePairs
from scex_sumo.metrics.pairs.scenes import PairValues, Samples, Scenes

MARGIN = 1e-6  # for rounding, so that the least pair is never lost
CHUNK = 1 << 13  # pairs at a time: the working arrays stay in the processor's cache


def gap(scenes: Scenes) -> Samples:
    """Body gap of all pairs, m; undefined for fewer than two vehicles.

    Returns:
        (P, C, T) of unordered pairs. Smaller is more critical.
    """
    pair, scene = np.divmod(np.arange(scenes.distance.size), max(int(np.prod(scenes.shape)), 1))
    return scenes.unordered(scenes.at_pairs(gaps_of, pair, scene).reshape(scenes.distance.shape))


def outline_pairs(scenes: Scenes, pair: IntArray, scene: IntArray) -> OutlinePairs:
    """Outlines of pairs in scenes given by flat index into (C, T), and how they move.

    Args:
        scenes: the batch.
        pair: (N,) number of the unordered pair.
        scene: (N,) flat index into (C, T).
    """
    one, two = (side[pair] for side in scenes.pairs)
    arrays = scenes.x, scenes.y, scenes.cos, scenes.sin, scenes.speed
    x, y, cos, sin, speed = (a.reshape(scenes.vehicles, -1) for a in arrays)
    cos_1, sin_1, cos_2, sin_2 = cos[one, scene], sin[one, scene], cos[two, scene], sin[two, scene]
    speed_1, speed_2 = speed[one, scene], speed[two, scene]
    return OutlinePairs(
        dx=x[two, scene] - x[one, scene],
        dy=y[two, scene] - y[one, scene],
        dvx=speed_2 * cos_2 - speed_1 * cos_1,
        dvy=speed_2 * sin_2 - speed_1 * sin_1,
        cos_1=cos_1,
        sin_1=sin_1,
        cos_2=cos_2,
        sin_2=sin_2,
        half_length_1=scenes.size_of(scenes.length, one, scene) / 2,
        half_width_1=scenes.size_of(scenes.width, one, scene) / 2,
        half_length_2=scenes.size_of(scenes.length, two, scene) / 2,
        half_width_2=scenes.size_of(scenes.width, two, scene) / 2,
    )


def in_chunks(
    pair: IntArray, scene: IntArray, value: Callable[[IntArray, IntArray], FloatArray]
) -> FloatArray:
    """(N,) a value of pairs in scenes, some thousand at a time."""
    parts = [slice(start, start + CHUNK) for start in range(0, pair.size, CHUNK)]
    return np.concatenate([np.empty(0), *(value(pair[part], scene[part]) for part in parts)])


def gaps_of(scenes: Scenes, pair: IntArray, scene: IntArray) -> FloatArray:
    """(N,) body gaps of pairs in scenes given by flat index into (C, T), m."""

    def some(pair: IntArray, scene: IntArray) -> FloatArray:
        pairs = outline_pairs(scenes, pair, scene)
        directions = pairs.cos_1, pairs.sin_1, pairs.cos_2, pairs.sin_2
        return distance_apart(pairs.dx, pairs.dy, *directions, pairs.own, pairs.other)

    return in_chunks(pair, scene, some)


def gap_bounds(scenes: Scenes) -> tuple[FloatArray, FloatArray]:
    """(P, C, T) least and most that the body gap can be, from circles around and within the outlines, m."""
    outer = np.hypot(scenes.length, scenes.width) / 2
    inner = np.minimum(scenes.length, scenes.width) / 2
    first, second = scenes.pairs
    least, most = (scenes.distance - (radius[first] + radius[second]) for radius in (outer, inner))
    return np.maximum(least, 0.0, out=least), np.maximum(most, 0.0, out=most)


def least_gap(scenes: Scenes) -> Samples:
    """Body gaps, as `gap` gives them, of the pairs that can be the nearest of their scene."""
    return scenes.once(_least_gap)


def _least_gap(scenes: Scenes) -> Samples:
    least, most = gap_bounds(scenes)
    # Of every scene the smallest most.
    bound = np.where(scenes.both_present, most, np.inf).min(axis=0, initial=np.inf)
    close: BoolArray = scenes.both_present & (least <= bound + MARGIN)
    return samples_of(scenes, close, gaps_of)


def samples_of(scenes: Scenes, close: BoolArray, values: PairValues) -> Samples:
    """Samples of some unordered pairs in their scenes, (P, C, T), with values by pair and scene."""
    full = np.zeros(close.shape)
    at = np.flatnonzero(close)
    full.reshape(-1)[at] = scenes.at_pairs(values, *np.divmod(at, max(int(np.prod(scenes.shape)), 1)))
    first, second = scenes.pairs
    return Samples(value=full, defined=close, row=first, other=second, symmetric=True)
