"""Near pairs of a batch of futures, and extrema from them alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.base import EXTENSION_M, EXTENSION_S, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

NEAR_M: Final = 20.0
"""Pairs whose circles are always farther apart than this are no near pairs."""
MIN_PAIRS = 500  # below, evaluating all pairs is as fast
MARGIN_M = 1.0  # for rounding
ROUNDING = 1e-9
MAX_SHARE = 0.7  # of near pairs, above which the search for them does not pay


def surroundings(speed: FloatArray, length: FloatArray) -> FloatArray:
    """Return the distance within which a vehicle's traffic quality counts others, m."""
    radius: FloatArray = (0.36 * speed) ** 2 + length + speed
    return radius


def near_pairs(tracks: SceneTracks, planned: PlannedPaths | None) -> tuple[IntArray, FloatArray] | None:
    """Return the numbers of the near pairs, and the least distance (P,) of each pair; None if most are near.

    A pair is near if the boxes around what both drive, in all futures, come within `NEAR_M` beyond both outer
    circles, or within the `surroundings` of either; or if the boxes around all that they drive and plan meet,
    with their widths and the straight lines on which leaders are searched for.
    """
    states, present = tracks.states[:, tracks.first :], tracks.present
    futures, steps, vehicles = states.shape
    first, second = np.triu_indices(vehicles, 1)
    if len(first) < MIN_PAIRS or steps < 2 or not futures:
        return None
    there = np.ones(states.shape, dtype=np.bool_) if present is None else present[:, tracks.first :]
    low, high = _extent([np.where(there, values, np.nan) for values in (states.x, states.y)])
    apart = np.maximum(np.maximum(low[:, second] - high[:, first], low[:, first] - high[:, second]), 0.0)
    length, width = (np.atleast_2d(size).max(axis=0) for size in (tracks.length, tracks.width))
    circle = np.hypot(length, width) / 2
    seen = np.where(there, surroundings(states.speed, length), 0.0).max(axis=(0, 1))
    reach = np.maximum(NEAR_M + circle[first] + circle[second], np.maximum(seen[first], seen[second]))
    distance = np.hypot(*apart)
    near = (distance <= reach) | _ways_meet(tracks, planned)
    share = np.count_nonzero(near) / len(first)
    return (np.flatnonzero(near), distance) if share < MAX_SHARE else None


def _ways_meet(tracks: SceneTracks, planned: PlannedPaths | None) -> BoolArray:
    """Return whether the ways of pairs (P,) may meet."""
    states, present = tracks.states, tracks.present
    there = np.ones(states.shape, dtype=np.bool_) if present is None else present
    low, high = _extent([np.where(there, values, np.nan) for values in (states.x, states.y)])
    if planned is not None:
        plan = _extent([values.swapaxes(2, 3) for values in (planned.x, planned.y)])
        low, high = np.minimum(low, plan[0]), np.maximum(high, plan[1])
    speed = np.where(there, np.abs(states.speed), 0.0).max(axis=(0, 1))
    width = np.atleast_2d(tracks.width).max(axis=0)
    ahead = np.maximum(EXTENSION_M, EXTENSION_S * speed) + width + MARGIN_M
    first, second = np.triu_indices(states.shape[2], 1)
    apart = np.maximum(low[:, second] - high[:, first], low[:, first] - high[:, second]).max(axis=0)
    return np.asarray(apart <= np.maximum(ahead[first] + width[second], ahead[second] + width[first]))


def _extent(values: Sequence[FloatArray]) -> FloatArray:
    """Return (2, N, V) lowest and highest values of vehicles over (..., V); inf and -inf if all are NaN."""
    every = [value.reshape(-1, value.shape[-1]) for value in values]
    low = np.stack([np.fmin.reduce(value, axis=0, initial=np.inf) for value in every])
    return np.stack([low, [np.fmax.reduce(value, axis=0, initial=-np.inf) for value in every]])


def least_of_near(
    scenes: Scenes, values: Callable[[Scenes], Samples], within: Callable[[float], float]
) -> Samples:
    """Return values of pairs that have the smallest value of each scene: the near ones, or more if needed.

    Args:
        within: returns the distance between the circles beyond which no pair has a value as small, m.
    """
    if scenes.near is None:
        return values(scenes)
    samples = values(scenes.near.scenes)
    least = np.where(samples.defined, samples.value, np.inf).min(axis=0, initial=np.inf).max(initial=0.0)
    reach = within(float(least)) * (1 + ROUNDING) if np.isfinite(least) else np.inf
    if reach <= NEAR_M:
        return samples
    (first, second), size = scenes.pairs, np.hypot(scenes.length, scenes.width).max(axis=(1, 2)) / 2
    pairs = scenes.near.apart <= reach + size[first] + size[second]
    pairs[scenes.near.pair] = True
    return values(scenes if pairs.all() else scenes.of_pair_numbers(np.flatnonzero(pairs)))
