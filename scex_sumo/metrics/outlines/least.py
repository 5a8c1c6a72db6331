"""Scene extrema of gap and WTTC of outlines: exact for the pairs that can be the least, no others."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.outlines.gap import gap_bounds, gaps_of
from scex_sumo.metrics.outlines.wttc_path import largest_accelerations, plane_meets_parabola, worst_times_of
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

_MARGIN = 1e-6  # for rounding, so that the least pair is never lost


def least_gap(scenes: Scenes) -> Samples:
    """Body gaps, as `gap` gives them, of the pairs that can be the nearest of their scene."""
    least, most = gap_bounds(scenes)
    # Of every scene the smallest most.
    bound = np.where(scenes.both_present, most, np.inf).min(axis=0, initial=np.inf)
    close: BoolArray = scenes.both_present & (least <= bound + _MARGIN)
    return _samples(scenes, close, gaps_of(scenes, *_places(close)))


def least_wttc_path(scenes: Scenes) -> Samples:
    """WTTC, as `wttc_path` gives them, of the pairs that can have the shortest of their scene.

    Along the line of the centres the outlines come no faster together than their extents along it, which
    bounds the time from below. The pair that is fastest by that bound is evaluated first; only pairs whose
    bound is below its time can be faster.
    """
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
    least = np.where(scenes.both_present, np.where(near > 0, least, 0.0), np.inf)
    if not least.size:
        return _samples(scenes, scenes.both_present, np.empty(0))
    scene = np.arange(int(np.prod(scenes.shape)))
    likely = least.argmin(axis=0).reshape(-1)
    bound = np.where(scenes.both_present.any(axis=0).reshape(-1), worst_times_of(scenes, likely, scene), -1.0)
    close: BoolArray = scenes.both_present & (least <= bound.reshape(scenes.shape) + _MARGIN)
    return _samples(scenes, close, worst_times_of(scenes, *_places(close)))


def _places(close: BoolArray) -> tuple[IntArray, IntArray]:
    pair, scene = np.divmod(np.flatnonzero(close), max(int(np.prod(close.shape[1:])), 1))
    return pair, scene


def _samples(scenes: Scenes, close: BoolArray, values: FloatArray) -> Samples:
    full = np.zeros(close.shape)
    full[close] = values
    first, second = scenes.pairs
    return Samples(value=full, defined=close, row=first, other=second, symmetric=True)
