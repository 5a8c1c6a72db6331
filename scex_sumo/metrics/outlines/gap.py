"""Body gap: the distance between the outlines of two vehicles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.geometry.rectangles import rectangle_distance
from scex_sumo.metrics.outlines.moving import OutlinePairs
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

CHUNK = 1 << 13  # pairs at a time: the working arrays stay in the processor's cache


def gap(scenes: Scenes) -> Samples:
    """Body gap of all pairs, m; undefined for fewer than two vehicles.

    Returns:
        (P, C, T) of unordered pairs. Smaller is more critical.
    """
    pair, scene = np.divmod(np.arange(scenes.dx.size), max(int(np.prod(scenes.shape)), 1))
    return scenes.unordered(gaps_of(scenes, pair, scene).reshape(scenes.dx.shape))


def size_of(scenes: Scenes, size: FloatArray, vehicle: IntArray, scene: IntArray) -> FloatArray:
    """(N,) lengths or widths of vehicles in scenes given by flat index into (C, T), m."""
    per_child: FloatArray = size[vehicle, scene // scenes.shape[1] if size.shape[1] > 1 else 0, 0]
    return per_child


def outline_pairs(scenes: Scenes, pair: IntArray, scene: IntArray) -> OutlinePairs:
    """Outlines of pairs in scenes given by flat index into (C, T), and how they move.

    Args:
        scenes: the batch.
        pair: (N,) number of the unordered pair.
        scene: (N,) flat index into (C, T).
    """
    one, two = (side[pair] for side in scenes.pairs)
    cos, sin, speed = (a.reshape(scenes.vehicles, -1) for a in (scenes.cos, scenes.sin, scenes.speed))
    cos_1, sin_1, cos_2, sin_2 = cos[one, scene], sin[one, scene], cos[two, scene], sin[two, scene]
    speed_1, speed_2 = speed[one, scene], speed[two, scene]
    return OutlinePairs(
        dx=scenes.dx.reshape(len(scenes.pairs[0]), -1)[pair, scene],
        dy=scenes.dy.reshape(len(scenes.pairs[0]), -1)[pair, scene],
        dvx=speed_2 * cos_2 - speed_1 * cos_1,
        dvy=speed_2 * sin_2 - speed_1 * sin_1,
        cos_1=cos_1,
        sin_1=sin_1,
        cos_2=cos_2,
        sin_2=sin_2,
        half_length_1=size_of(scenes, scenes.length, one, scene) / 2,
        half_width_1=size_of(scenes, scenes.width, one, scene) / 2,
        half_length_2=size_of(scenes, scenes.length, two, scene) / 2,
        half_width_2=size_of(scenes, scenes.width, two, scene) / 2,
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
        return rectangle_distance(
            dx=pairs.dx,
            dy=pairs.dy,
            cos_1=pairs.cos_1,
            sin_1=pairs.sin_1,
            cos_2=pairs.cos_2,
            sin_2=pairs.sin_2,
            length_1=2 * pairs.half_length_1,
            width_1=2 * pairs.half_width_1,
            length_2=2 * pairs.half_length_2,
            width_2=2 * pairs.half_width_2,
        )

    return in_chunks(pair, scene, some)


def gap_bounds(scenes: Scenes) -> tuple[FloatArray, FloatArray]:
    """(P, C, T) least and most that the body gap can be, from circles around and within the outlines, m."""
    first, second = scenes.pairs
    outer = np.hypot(scenes.length, scenes.width) / 2
    inner = np.minimum(scenes.length, scenes.width) / 2
    least = scenes.distance - (outer[first] + outer[second])
    most = scenes.distance - (inner[first] + inner[second])
    return np.maximum(least, 0.0), np.maximum(most, 0.0)
