"""Extrema of scenes and futures, and means over scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows, least_of
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes
from scex_sumo.metrics.registry import Metric


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneValues(Rows):
    """The most critical value of every scene, (C, T); NaN where undefined, inf where only inf is left out."""

    value: FloatArray
    defined: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Worst(Rows):
    """Origin of the most critical value of every future; valid only where ``defined``."""

    value: FloatArray  # (C,) as aggregated; NaN where undefined
    defined: BoolArray
    step: IntArray  # (C,) on the step axis of the tracks, history included
    vehicle: IntArray  # (C,) the row's own vehicle (the follower)
    other: IntArray | None  # (C,) the second vehicle; None for metrics of single vehicles


def extrema(metric: Metric, samples: Samples | Entries, scenes: Scenes) -> tuple[SceneValues, Worst]:
    """Find the extremum of every scene, and that of every future with its first step and row."""
    if isinstance(samples, Samples):
        where, value = np.flatnonzero(samples.defined), samples.value[samples.defined]
        vehicle, other = samples.row, samples.other
    else:
        where, value, (vehicle, other) = samples.where, samples.value, scenes.ordered_pairs
    sign = 1.0 if metric.critical == "min" else -1.0
    with np.errstate(divide="ignore"):
        cost = sign * (1.0 / value if metric.inverse else value)  # the smallest is the most critical
    scene, (has_value, defined) = where % scenes.count, np.zeros((2, *scenes.shape), dtype=bool)
    has_value.reshape(-1)[scene] = True
    if metric.finite:
        finite = np.flatnonzero(np.isfinite(cost))
        where, scene, cost = where[finite], scene[finite], cost[finite]
    defined.reshape(-1)[scene] = True
    least = np.full(scenes.shape, np.inf)
    np.minimum.at(least.reshape(-1), scene, cost)
    of_scenes = np.where(defined, sign * least, np.where(has_value, np.inf, np.nan))

    best = np.flatnonzero(cost == least.reshape(-1)[scene])
    future, step = np.divmod(scene[best], max(scenes.tracks.steps, 1))
    first = least_of(future, cost[best], step)
    future, step, row = future[first], step[first], where[best[first]] // scenes.count
    of_futures, origin = np.full(len(least), np.nan), np.zeros((3, len(least)), dtype=np.int64)
    of_futures[future] = of_scenes[future, step]
    origin[:, future] = step + scenes.tracks.first, vehicle[row], row if other is None else other[row]
    worst = Worst(
        value=of_futures,
        defined=np.asarray(defined.any(axis=1)),
        step=origin[0],
        vehicle=origin[1],
        other=None if other is None else origin[2],
    )
    return SceneValues(value=of_scenes, defined=defined), worst


def scene_mean(scene: SceneValues, *, harmonic: bool) -> FloatArray:
    """Return (C,) means of the scenes' extrema where defined; harmonic: 1 / mean(1 / value)."""
    count, total = scene_sums(scene, harmonic=harmonic)
    over, under = (count, total) if harmonic else (total, count)
    mean: FloatArray = np.divide(over, under, out=np.full(count.shape, np.nan), where=under > 0)
    return mean


def scene_sums(scene: SceneValues, *, harmonic: bool) -> tuple[FloatArray, FloatArray]:
    """Return (C,) number of scenes that count, and (C,) sum of their values or of 1 / value."""
    if not harmonic:
        total = np.where(scene.defined, scene.value, 0.0).sum(axis=1)
        return scene.defined.sum(axis=1).astype(np.float64), total
    # Undefined scenes are NaN; infinite ones, left out of the extrema, count as 0.
    known = ~np.isnan(scene.value)
    with np.errstate(divide="ignore"):
        inverse = np.where(known, 1.0 / np.where(known, scene.value, 1.0), 0.0)
    return known.sum(axis=1).astype(np.float64), inverse.sum(axis=1)
