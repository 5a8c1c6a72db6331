"""Extrema of scenes and children, and means of scenes: what becomes of the values of pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.pairs.scenes import Samples


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneValues:
    """The most critical value of every scene.

    Attributes:
        value: (C, T) as aggregated (``ttc`` in 1/s); NaN where undefined, inf where all are infinite and
            infinite values are left out.
        defined: (C, T).
    """

    value: FloatArray
    defined: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Worst:
    """Where a metric was most critical in every child, and who made it; read only where ``defined``.

    Attributes:
        value: (C,) as aggregated; NaN where undefined.
        defined: (C,).
        step: (C,) index on the step axis of the tracks, history included.
        vehicle: (C,) the row's own vehicle (the follower).
        other: (C,) the second vehicle; None for metrics of single vehicles.
    """

    value: FloatArray
    defined: BoolArray
    step: IntArray
    vehicle: IntArray
    other: IntArray | None


def extrema(metric: Metric, samples: Samples, first_step: int) -> tuple[SceneValues, Worst]:
    """Extremum of every scene, then of every child, with its origin."""
    sign = 1.0 if metric.critical == "min" else -1.0
    value, defined = samples.value, samples.defined
    if metric.inverse:
        with np.errstate(divide="ignore"):
            value = 1.0 / value
    infinite: BoolArray | None = None
    if metric.finite:
        infinite = np.any(defined, axis=0)
        defined = defined & np.isfinite(value)
    # The smallest cost is the most critical; inf is a value, so undefined needs its own mask.
    cost = np.where(defined, sign * value, np.inf)
    scene_defined: BoolArray = np.any(defined, axis=0)
    scene_cost = cost.min(axis=0, initial=np.inf)
    scene_value = np.where(scene_defined, sign * scene_cost, np.nan)
    if infinite is not None:
        scene_value = np.where(infinite & ~scene_defined, np.inf, scene_value)
    children, steps = scene_cost.shape
    child = np.arange(children)
    child_defined: BoolArray = np.any(scene_defined, axis=1)
    if steps == 0 or len(samples.row) == 0:
        nobody = np.zeros(children, dtype=np.int64)
        other = None if samples.other is None else nobody
        worst = Worst(
            value=np.full(children, np.nan), defined=child_defined, step=nobody, vehicle=nobody, other=other
        )
        return SceneValues(value=scene_value, defined=scene_defined), worst
    step = _first_smallest(scene_cost, scene_defined)
    entry = _first_smallest(cost[:, child, step].T, defined[:, child, step].T)
    worst = Worst(
        value=np.where(child_defined, scene_value[child, step], np.nan),
        defined=child_defined,
        step=step + first_step,
        vehicle=samples.row[entry],
        other=None if samples.other is None else samples.other[entry],
    )
    return SceneValues(value=scene_value, defined=scene_defined), worst


def _first_smallest(cost: FloatArray, defined: BoolArray) -> IntArray:
    """(N,) index of the first defined smallest cost along the last axis of (N, M)."""
    smallest = cost.min(axis=-1, keepdims=True)
    index: IntArray = np.argmax(defined & (cost == smallest), axis=-1)
    return index


def scene_mean(scene: SceneValues, *, harmonic: bool) -> FloatArray:
    """(C,) mean of the scenes' extrema where defined; harmonic: 1 / mean(1 / value), 0 for infinite ones.

    An arithmetic mean of times is decided by the longest ones, those of speeds that hardly differ.
    """
    count, total = scene_sums(scene, harmonic=harmonic)
    some = count > 0 if not harmonic else total > 0
    over, under = (count, total) if harmonic else (total, count)
    mean: FloatArray = np.divide(over, under, out=np.full(count.shape, np.nan), where=some)
    return mean


def scene_sums(scene: SceneValues, *, harmonic: bool) -> tuple[FloatArray, FloatArray]:
    """(C,) number of scenes that count and sum of their values, or of 1 / value."""
    if not harmonic:
        total = np.where(scene.defined, scene.value, 0.0).sum(axis=1)
        return scene.defined.sum(axis=1).astype(np.float64), total
    # Undefined scenes are NaN; infinite ones, left out of the extrema, are known and count as 0.
    known = ~np.isnan(scene.value)
    with np.errstate(divide="ignore"):
        inverse = np.where(known, 1.0 / np.where(known, scene.value, 1.0), 0.0)
    return known.sum(axis=1).astype(np.float64), inverse.sum(axis=1)
