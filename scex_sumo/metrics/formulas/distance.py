"""Distance of the centres of two vehicles, and of their outlines (body gap)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.geometry.rectangles import distance_apart
from scex_sumo.metrics.pairs.near import least_of_near
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

MARGIN = 1e-6  # for rounding, so that the nearest pair is never lost
CHUNK = 1 << 13  # pairs at a time: fits the processor's cache


def distance(scenes: Scenes) -> Samples:
    """Compute the distance of the centres of all pairs, m."""
    return scenes.unordered(scenes.distance)


def gap(scenes: Scenes) -> Samples:
    """Compute the body gap of all pairs, m; 0 on overlap."""
    return scenes.of_some_pairs(gaps_of)


@dataclass(frozen=True, kw_only=True, eq=False)
class OutlinePairs(Rows):
    """N pairs of rectangles in motion; metres, seconds, second vehicle minus first."""

    dx: FloatArray
    dy: FloatArray
    dvx: FloatArray
    dvy: FloatArray
    cos_1: FloatArray  # (N,) direction of the first rectangle's length
    sin_1: FloatArray
    cos_2: FloatArray
    sin_2: FloatArray
    half_length_1: FloatArray
    half_width_1: FloatArray
    half_length_2: FloatArray
    half_width_2: FloatArray

    @property
    def own(self) -> tuple[FloatArray, FloatArray]:
        """(N,) half length and width of the first, m."""
        return self.half_length_1, self.half_width_1

    @property
    def other(self) -> tuple[FloatArray, FloatArray]:
        """(N,) half length and width of the second, m."""
        return self.half_length_2, self.half_width_2


def outline_pairs(scenes: Scenes, pair: IntArray, scene: IntArray) -> OutlinePairs:
    """Return outlines and velocities of (N,) pairs in scenes."""
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
    """Compute (N,) values, some thousand at a time."""
    chunks = [slice(start, start + CHUNK) for start in range(0, pair.size, CHUNK)]
    return np.concatenate([np.empty(0), *(value(pair[chunk], scene[chunk]) for chunk in chunks)])


def gaps_of(scenes: Scenes, pair: IntArray, scene: IntArray) -> FloatArray:
    """Compute (N,) body gaps of pairs in scenes, m."""

    def of_chunk(pair: IntArray, scene: IntArray) -> FloatArray:
        pairs = outline_pairs(scenes, pair, scene)
        directions = pairs.cos_1, pairs.sin_1, pairs.cos_2, pairs.sin_2
        return distance_apart(pairs.dx, pairs.dy, directions, pairs.own, pairs.other)

    return in_chunks(pair, scene, of_chunk)


def gap_bounds(scenes: Scenes) -> tuple[FloatArray, FloatArray]:
    """Bound the body gap by circles: (P, C, T) lower and upper, m."""
    outer = np.hypot(scenes.length, scenes.width) / 2
    inner = np.minimum(scenes.length, scenes.width) / 2
    first, second = scenes.pairs
    low, high = (scenes.distance - (radius[first] + radius[second]) for radius in (outer, inner))
    return np.maximum(low, 0.0, out=low), np.maximum(high, 0.0, out=high)


def least_gap(scenes: Scenes) -> Samples:
    """Compute the body gaps of the pairs that can be the nearest of their scene, m."""
    return scenes.once(_least_gap_of_near)


def _least_gap_of_near(scenes: Scenes) -> Samples:
    return least_of_near(scenes, _least_gap, float)


def _least_gap(scenes: Scenes) -> Samples:
    low, high = gap_bounds(scenes)
    bound = np.where(scenes.both_present, high, np.inf).min(axis=0, initial=np.inf)
    close: BoolArray = scenes.both_present & (low <= bound + MARGIN)
    return scenes.of_some_pairs(gaps_of, close)
