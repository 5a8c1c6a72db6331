"""Extrema of scenes and futures, and means over scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
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
    """Find the extremum of every scene, then of every future with its origin."""
    sign = 1.0 if metric.critical == "min" else -1.0
    value = samples.value
    if metric.inverse:
        with np.errstate(divide="ignore"):
            value = 1.0 / value
    cost = sign * value  # the smallest is the most critical
    if isinstance(samples, Entries):
        least, defined, infinite, origin = _least_of_entries(
            samples.where, cost, scenes, finite=metric.finite
        )
    else:
        least, defined, infinite, origin = _least_of_samples(samples, cost, finite=metric.finite)
    scene_value = np.where(defined, sign * least, np.nan)
    scene_value = np.where(infinite & ~defined, np.inf, scene_value)
    future, future_defined = np.arange(len(scene_value)), np.any(defined, axis=1)
    row, other = (samples.row, samples.other) if isinstance(samples, Samples) else scenes.ordered_pairs
    if least.shape[1] == 0 or len(row) == 0:
        nobody = np.zeros(len(future), dtype=np.int64)
        second = None if other is None else nobody
        nowhere = np.full(len(future), np.nan)
        worst = Worst(value=nowhere, defined=future_defined, step=nobody, vehicle=nobody, other=second)
        return SceneValues(value=scene_value, defined=defined), worst
    step = _first_smallest(least, defined)
    entry = origin(step)
    worst = Worst(
        value=np.where(future_defined, scene_value[future, step], np.nan),
        defined=future_defined,
        step=step + scenes.tracks.first,
        vehicle=row[entry],
        other=None if other is None else other[entry],
    )
    return SceneValues(value=scene_value, defined=defined), worst


_Least: TypeAlias = tuple[FloatArray, BoolArray, BoolArray, Callable[[IntArray], IntArray]]
"""(C, T) least costs of scenes, inf where undefined; where they are defined; where infinite values were left
out; a function that returns (C,) the first row with the least cost, given a step of each future."""


def _least_of_samples(samples: Samples, cost: FloatArray, *, finite: bool) -> _Least:
    defined = samples.defined & np.isfinite(cost) if finite else samples.defined
    infinite = np.any(samples.defined, axis=0) if finite else np.zeros(cost.shape[1:], dtype=bool)
    cost = np.where(defined, cost, np.inf)

    def origin(step: IntArray) -> IntArray:
        future = np.arange(len(step))
        return _first_smallest(cost[:, future, step].T, defined[:, future, step].T)

    least = cost.min(axis=0, initial=np.inf)
    return least, np.any(defined, axis=0), infinite, origin


def _least_of_entries(where: IntArray, cost: FloatArray, scenes: Scenes, *, finite: bool) -> _Least:
    futures, steps = scenes.shape
    infinite, defined = np.zeros((2, futures * steps), dtype=bool)
    if finite:
        infinite[where % scenes.count] = True
        known = np.flatnonzero(np.isfinite(cost))
        where, cost = where[known], cost[known]
    row, scene = np.divmod(where, scenes.count)
    defined[scene] = True
    least = np.full(futures * steps, np.inf)
    np.minimum.at(least, scene, cost)

    def origin(step: IntArray) -> IntArray:
        at = np.zeros(futures * steps, dtype=bool)
        at[np.arange(futures) * steps + step] = True
        best = np.flatnonzero(at[scene] & (cost == least[scene]))
        rows = np.full(futures, len(scenes.ordered_pairs[0]))
        np.minimum.at(rows, scene[best] // steps, row[best])
        return np.where(rows < len(scenes.ordered_pairs[0]), rows, 0)

    least_cost, is_defined, is_infinite = (a.reshape(futures, steps) for a in (least, defined, infinite))
    return least_cost, is_defined, is_infinite, origin


def _first_smallest(cost: FloatArray, defined: BoolArray) -> IntArray:
    smallest = cost.min(axis=-1, keepdims=True)
    index: IntArray = np.argmax(defined & (cost == smallest), axis=-1)
    return index


def scene_mean(scene: SceneValues, *, harmonic: bool) -> FloatArray:
    """Return (C,) means of the scenes' extrema where defined; harmonic: 1 / mean(1 / value)."""
    count, total = scene_sums(scene, harmonic=harmonic)
    some = count > 0 if not harmonic else total > 0
    over, under = (count, total) if harmonic else (total, count)
    mean: FloatArray = np.divide(over, under, out=np.full(count.shape, np.nan), where=some)
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
