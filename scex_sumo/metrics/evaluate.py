"""Evaluation of whole runs: nanoscopic values to scenes to children."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import InputError
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.pairs.scenes import Samples, Scenes
from scex_sumo.metrics.registry import columns_of, metrics_named, preset_named

BATCH_PAIR_STEPS = 1 << 16  # unordered pair-steps per batch: the working arrays stay in the processor's cache

PAPER: Final = MetricParameters()
PAPER_PRESET: Final = "paper"


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneValues:
    """The most critical value of every scene.

    Attributes:
        value: (C, T) as aggregated (``ttc`` in 1/s); NaN where undefined.
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioValues:
    """Microscopic values: two per child and metric, with what they are made of.

    Attributes:
        columns: (M,) names of the columns.
        values: (C, M); NaN where undefined.
        defined: (C, M).
        scene: by metric, the extremum of every evaluated step.
        worst: by metric, the step and the vehicles of the extremum.
        preset: rule for car-following that was used.
    """

    columns: tuple[str, ...]
    values: FloatArray
    defined: BoolArray
    scene: Mapping[str, SceneValues]
    worst: Mapping[str, Worst]
    preset: str

    def column(self, name: str) -> tuple[FloatArray, BoolArray]:
        """(C,) values and mask of one column."""
        index = self.columns.index(name)
        return self.values[:, index], self.defined[:, index]


@dataclass(frozen=True, kw_only=True, eq=False)
class PairValues:
    """Nanoscopic values of one metric, one row per ordered pair (or vehicle) where defined.

    Attributes:
        child: (N,).
        step: (N,) index on the step axis of the tracks, history included.
        vehicle: (N,) the row's own vehicle (the follower).
        other: (N,) the second vehicle; None for metrics of single vehicles.
        value: (N,) ``ttc`` in s, not inverted; inf allowed.
    """

    child: IntArray
    step: IntArray
    vehicle: IntArray
    other: IntArray | None
    value: FloatArray


D = TypeVar("D", SceneValues, Worst, PairValues)


def evaluate(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    preset: str = PAPER_PRESET,
    parameters: MetricParameters = PAPER,
    metrics: Sequence[str | Metric] | None = None,
    vehicles: Collection[int] | None = None,
) -> ScenarioValues:
    """Metrics of every child.

    Args:
        tracks: what the vehicles did; steps before ``tracks.first`` are history.
        planned: their planned paths, for gap time (undefined without).
        preset: rule for car-following.
        parameters: constants.
        metrics: names, or the metrics themselves; the paper's six by default.
        vehicles: values are of pairs that involve one of these (indices), or of these themselves; None: all.

    Returns:
        The most critical value and the mean of the scenes' most critical values, per child and metric.
    """
    chosen = metrics_named(metrics)
    parts: dict[str, list[tuple[SceneValues, Worst]]] = {metric.name: [] for metric in chosen}
    for _, metric, samples in _samples(tracks, planned, preset, parameters, chosen):
        wanted = samples if vehicles is None else _of_vehicles(samples, vehicles)
        parts[metric.name].append(_reduce(metric, wanted, tracks.first))
    scene = {name: _joined([p[0] for p in part]) for name, part in parts.items()}
    worst = {name: _joined([p[1] for p in part]) for name, part in parts.items()}
    values = [column for m in chosen for column in (worst[m.name].value, _mean(scene[m.name]))]
    defined = np.repeat(np.stack([worst[m.name].defined for m in chosen], axis=1), 2, axis=1)
    return ScenarioValues(
        columns=columns_of(chosen),
        values=np.stack(values, axis=1),
        defined=defined,
        scene=scene,
        worst=worst,
        preset=preset,
    )


def evaluate_pairs(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    preset: str = PAPER_PRESET,
    parameters: MetricParameters = PAPER,
    metrics: Sequence[str | Metric] | None = None,
) -> dict[str, PairValues]:
    """Nanoscopic values of every metric, sorted by child, step, vehicle, other; arguments as ``evaluate``."""
    chosen = metrics_named(metrics)
    parts: dict[str, list[PairValues]] = {metric.name: [] for metric in chosen}
    for offset, metric, samples in _samples(tracks, planned, preset, parameters, chosen):
        parts[metric.name].append(_rows(samples, offset, tracks.first))
    return {name: _joined(part) for name, part in parts.items()}


def _samples(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    preset: str,
    parameters: MetricParameters,
    metrics: Sequence[Metric],
) -> Iterator[tuple[int, Metric, Samples]]:
    """Values of a few children at a time: the number of the first child, the metric, its values."""
    rules = preset_named(preset)
    children, _, vehicles = tracks.states.shape
    if planned is not None:
        planned.check_fit(tracks)
    per_child = max(tracks.steps * vehicles * (vehicles - 1) // 2, 1)
    size = max(BATCH_PAIR_STEPS // per_child, 1)
    for start in range(0, max(children, 1), size):
        part = slice(start, start + size)
        scenes = Scenes(
            tracks=tracks.children(part),
            planned=None if planned is None else planned.children(part),
            parameters=parameters,
            preset=rules,
        )
        for metric in metrics:
            samples = metric.evaluate(scenes)
            _check_samples(metric, samples, scenes)
            yield start, metric, samples
        scenes.release()


def _check_samples(metric: Metric, samples: Samples, scenes: Scenes) -> None:
    """Raise an `InputError` where a metric's function did not return what it is to return."""
    if not isinstance(samples, Samples):
        raise InputError(f"metric {metric.name}: returned {type(samples).__name__}, needs Samples")
    shape = (len(samples.row), *scenes.shape)
    if samples.value.shape != shape or samples.defined.shape != shape or samples.defined.dtype != np.bool_:
        raise InputError(
            f"metric {metric.name}: values {samples.value.shape} and mask {samples.defined.shape} "
            f"({samples.defined.dtype}) of {len(samples.row)} rows; both need shape {shape}, the mask bool"
        )


def _of_vehicles(samples: Samples, vehicles: Collection[int]) -> Samples:
    """The rows that involve one of some vehicles."""
    wanted = np.array(sorted(vehicles), dtype=np.int64)
    keep: BoolArray = np.isin(samples.row, wanted)
    if samples.other is not None:
        keep = keep | np.isin(samples.other, wanted)
    return replace(
        samples,
        value=samples.value[keep],
        defined=samples.defined[keep],
        row=samples.row[keep],
        other=None if samples.other is None else samples.other[keep],
    )


def _reduce(metric: Metric, samples: Samples, first_step: int) -> tuple[SceneValues, Worst]:
    """Extremum of every scene, then of every child, with its origin."""
    sign = 1.0 if metric.critical == "min" else -1.0
    value, defined = samples.value, samples.defined
    if metric.inverse:
        with np.errstate(divide="ignore"):
            value = 1.0 / value
    if metric.finite:
        defined = defined & np.isfinite(value)
    # The smallest cost is the most critical; inf is a value, so undefined needs its own mask.
    cost = np.where(defined, sign * value, np.inf)
    scene_defined: BoolArray = np.any(defined, axis=0)
    scene_cost = cost.min(axis=0, initial=np.inf)
    scene_value = np.where(scene_defined, sign * scene_cost, np.nan)
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
        value=scene_value[child, step],
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


def _mean(scene: SceneValues) -> FloatArray:
    """(C,) mean of the scenes' extrema where defined."""
    count = scene.defined.sum(axis=1)
    total = np.where(scene.defined, scene.value, 0.0).sum(axis=1)
    mean: FloatArray = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    return mean


def _rows(samples: Samples, first_child: int, first_step: int) -> PairValues:
    """Defined values as rows; a symmetric pair gives two."""
    entry, child, step = np.nonzero(samples.defined)
    value = samples.value[entry, child, step]
    vehicle = samples.row[entry]
    other = None if samples.other is None else samples.other[entry]
    if samples.symmetric and other is not None:
        vehicle, other = np.concatenate([vehicle, other]), np.concatenate([other, vehicle])
        child, step, value = np.tile(child, 2), np.tile(step, 2), np.tile(value, 2)
    keys = (vehicle, step, child) if other is None else (other, vehicle, step, child)
    order = np.lexsort(keys)
    return PairValues(
        child=child[order] + first_child,
        step=step[order] + first_step,
        vehicle=vehicle[order],
        other=None if other is None else other[order],
        value=value[order],
    )


def _joined(parts: Sequence[D]) -> D:
    """Values of all children from those of a few at a time."""

    def join(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        return None if arrays[0] is None else np.concatenate(arrays)

    return replace(parts[0], **{f.name: join(f.name) for f in fields(parts[0])})
