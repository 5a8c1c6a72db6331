"""Evaluation of whole runs: nanoscopic values to scenes to children."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import InputError
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.scenes import Metric, Samples, Scenes
from scex_sumo.metrics.registry import PAPER_METRICS, metrics_named, preset_named

COLUMNS: Final[tuple[str, ...]] = tuple(column for name in PAPER_METRICS for column in (name, f"{name}_mean"))
"""The twelve columns of a child scenario; ``ttc`` and ``ttc_mean`` are in 1/s."""

BATCH_PAIR_STEPS = 1 << 16  # unordered pair-steps per batch: the working arrays stay in the processor's cache

PAPER: Final = MetricParameters()
PAPER_PRESET: Final = "paper"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioValues:
    """Microscopic values: twelve per child, with what they are made of.

    Attributes:
        columns: names of the columns.
        values: (C, 12); NaN where undefined.
        defined: (C, 12).
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
        metrics: names; the paper's six by default.
        vehicles: values are of pairs that involve one of these (indices), or of these themselves; None: all.

    Returns:
        The most critical value and the mean of the scenes' most critical values, per child and metric.
    """
    chosen = metrics_named(metrics)
    parts: dict[str, list[tuple[SceneValues, Worst]]] = {metric.name: [] for metric in chosen}
    for _, scenes in _batches(tracks, planned, preset, parameters):
        for metric in chosen:
            samples = metric.evaluate(scenes)
            if vehicles is not None:
                samples = _of_vehicles(samples, vehicles)
            parts[metric.name].append(_reduce(metric, samples, tracks.first))
    children = tracks.states.shape[0]
    scene = {
        name: _join_scenes([p[0] for p in part], (children, tracks.steps)) for name, part in parts.items()
    }
    worst = {name: _join_worst([p[1] for p in part]) for name, part in parts.items()}
    values = np.full((children, 2 * len(chosen)), np.nan)
    for index, metric in enumerate(chosen):
        values[:, 2 * index] = worst[metric.name].value
        values[:, 2 * index + 1] = scene_mean(scene[metric.name], harmonic=metric.harmonic)
    defined = np.repeat(np.stack([worst[m.name].defined for m in chosen], axis=1), 2, axis=1)
    columns = tuple(column for m in chosen for column in (m.name, f"{m.name}_mean"))
    return ScenarioValues(
        columns=columns, values=values, defined=defined, scene=scene, worst=worst, preset=preset
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
    for offset, scenes in _batches(tracks, planned, preset, parameters):
        for metric in chosen:
            parts[metric.name].append(_rows(metric.evaluate(scenes), offset, tracks.first))
    return {name: _join_pairs(part) for name, part in parts.items()}


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


def _batches(
    tracks: SceneTracks, planned: PlannedPaths | None, preset: str, parameters: MetricParameters
) -> Iterator[tuple[int, Scenes]]:
    """Scenes of a few children at a time, with the number of the first child."""
    rules = preset_named(preset)
    children, _, vehicles = tracks.states.shape
    _check_planned(tracks, planned)
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
        yield start, scenes
        scenes.release()


def _check_planned(tracks: SceneTracks, planned: PlannedPaths | None) -> None:
    if planned is None:
        return
    children, _, vehicles = tracks.states.shape
    shape = planned.x.shape
    if (shape[0], shape[2]) != (children, vehicles) or planned.index.shape != (tracks.steps,):
        raise InputError(
            f"planned paths are of {shape[0]} children, {shape[2]} vehicles and {planned.index.size} steps, "
            f"the tracks of {children}, {vehicles} and {tracks.steps} evaluated steps; pass matching ones"
        )


def _reduce(metric: Metric, samples: Samples, first_step: int) -> tuple[SceneValues, Worst]:
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


def _join_scenes(parts: list[SceneValues], shape: tuple[int, int]) -> SceneValues:
    return SceneValues(
        value=np.concatenate([p.value for p in parts]).reshape(shape),
        defined=np.concatenate([p.defined for p in parts]).reshape(shape),
    )


def _join_worst(parts: list[Worst]) -> Worst:
    others = [p.other for p in parts if p.other is not None]
    return Worst(
        value=np.concatenate([p.value for p in parts]),
        defined=np.concatenate([p.defined for p in parts]),
        step=np.concatenate([p.step for p in parts]),
        vehicle=np.concatenate([p.vehicle for p in parts]),
        other=np.concatenate(others) if others else None,
    )


def _join_pairs(parts: list[PairValues]) -> PairValues:
    others = [p.other for p in parts if p.other is not None]
    return PairValues(
        child=np.concatenate([p.child for p in parts]),
        step=np.concatenate([p.step for p in parts]),
        vehicle=np.concatenate([p.vehicle for p in parts]),
        other=np.concatenate(others) if others else None,
        value=np.concatenate([p.value for p in parts]),
    )
