"""Evaluation of metrics: values of pairs, extrema per scene, microscopic values per child."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import InputError, ScexError
from scex_sumo.base.importing import own_error_reason
from scex_sumo.metrics.base import PAPER, MetricParameters, PlannedPaths, Rows, SceneTracks
from scex_sumo.metrics.extrema import SceneValues, Worst, extrema, scene_mean
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.pairs.batches import scene_batches
from scex_sumo.metrics.pairs.leaders import preset_named
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes
from scex_sumo.metrics.registry import METRICS, columns_of, metrics_named

PAPER_PRESET: Final = "paper"


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioValues:
    """Microscopic values, two per child and metric, and their origin."""

    columns: tuple[str, ...]  # (M,) names
    values: FloatArray  # (C, M); NaN where undefined
    defined: BoolArray
    scene: Mapping[str, SceneValues]  # by metric, the extremum of every evaluated step
    worst: Mapping[str, Worst]  # by metric, the step and the vehicles of the extremum
    preset: str  # car-following rule

    def column(self, name: str) -> tuple[FloatArray, BoolArray]:
        """Return (C,) values and mask of a column."""
        index = self.columns.index(name)
        return self.values[:, index], self.defined[:, index]


@dataclass(frozen=True, kw_only=True, eq=False)
class PairValues(Rows):
    """Nanoscopic values of one metric, one row per ordered pair (or vehicle) where defined."""

    child: IntArray
    step: IntArray  # on the step axis of the tracks, history included
    vehicle: IntArray
    other: IntArray | None  # the second vehicle; None for metrics of single vehicles
    value: FloatArray  # ``ttc`` in s, not inverted; inf is a value


def evaluate(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    preset: str = PAPER_PRESET,
    parameters: MetricParameters = PAPER,
    metrics: Sequence[str | Metric] | None = None,
    vehicles: Collection[int] | None = None,
    also: Callable[[int, Scenes], None] | None = None,
) -> ScenarioValues:
    """Evaluate metrics of every child: most critical value and mean of the scenes' most critical values.

    Args:
        planned: gap time is undefined without planned paths.
        preset: car-following rule of metrics without one of their own.
        metrics: None for the paper's six.
        vehicles: only values that involve one of these indices; None for all.
        also: called with each batch's first child and scenes.
    """
    chosen = metrics_named(metrics)
    parts: dict[str, list[tuple[SceneValues, Worst]]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned, preset=preset, parameters=parameters):
        own = scenes if vehicles is None else scenes.of_vehicles(vehicles)
        for metric in chosen:
            if vehicles is None or metric.quick is not None:
                samples = _samples(metric, own, quick=True)
            else:  # leaders and traffic quality depend on all vehicles
                samples = _of_vehicles(_samples(metric, scenes, quick=False), vehicles, scenes)
            parts[metric.name].append(extrema(metric, samples, scenes))
        if also is not None:
            also(start, scenes)
    scene = {name: SceneValues.join([p[0] for p in part]) for name, part in parts.items()}
    worst = {name: Worst.join([p[1] for p in part]) for name, part in parts.items()}
    values = [
        column
        for m in chosen
        for column in (worst[m.name].value, scene_mean(scene[m.name], harmonic=m.harmonic))
    ]
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
    """Evaluate all pairs by metric, sorted by child, step, vehicle, other; see `evaluate`."""
    chosen = metrics_named(metrics)
    parts: dict[str, list[PairValues]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned, preset=preset, parameters=parameters):
        for metric in chosen:
            samples = _samples(metric, scenes, quick=False)
            parts[metric.name].append(_rows(_dense(samples, scenes), start, tracks.first))
    return {name: PairValues.join(part) for name, part in parts.items()}


def _samples(metric: Metric, scenes: Scenes, *, quick: bool) -> Samples | Entries:
    function = metric.quick if quick and metric.quick is not None else metric.evaluate
    seen = scenes if metric.preset is None else scenes.under(preset_named(metric.preset))
    try:
        samples = function(seen)
    except Exception as error:
        if metric.name in METRICS or isinstance(error, ScexError):
            raise
        raise InputError(f"metric {metric.name}: {own_error_reason(error)}") from error
    if isinstance(samples, Entries):
        return samples
    if not isinstance(samples, Samples):
        raise InputError(f"metric {metric.name}: returned {type(samples).__name__}, needs Samples")
    shape = (len(samples.row), *scenes.shape)
    if samples.value.shape != shape or samples.defined.shape != shape or samples.defined.dtype != np.bool_:
        raise InputError(
            f"metric {metric.name}: values {samples.value.shape} and mask {samples.defined.shape} "
            f"({samples.defined.dtype}) of {len(samples.row)} rows; both need shape {shape}, the mask bool"
        )
    return samples


def _dense(samples: Samples | Entries, scenes: Scenes) -> Samples:
    return scenes.scattered(samples.where, samples.value) if isinstance(samples, Entries) else samples


def _of_vehicles(samples: Samples | Entries, vehicles: Collection[int], scenes: Scenes) -> Samples:
    samples = _dense(samples, scenes)
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


def _rows(samples: Samples, first_child: int, first_step: int) -> PairValues:
    entry, child, step = np.nonzero(samples.defined)
    value = samples.value[entry, child, step]
    vehicle = samples.row[entry]
    other = None if samples.other is None else samples.other[entry]
    if samples.symmetric and other is not None:
        vehicle, other = np.concatenate([vehicle, other]), np.concatenate([other, vehicle])
        child, step, value = np.tile(child, 2), np.tile(step, 2), np.tile(value, 2)
    keys = (vehicle, step, child) if other is None else (other, vehicle, step, child)
    rows = PairValues(
        child=child + first_child, step=step + first_step, vehicle=vehicle, other=other, value=value
    )
    return rows.take(np.lexsort(keys))
