"""Nanoscopic values: those of each pair of vehicles, or each vehicle, at each step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.metrics.base import PAPER, MetricParameters, PlannedPaths, Rows, SceneTracks
from scex_sumo.metrics.evaluate import PAPER_PRESET, dense, samples_of, scene_batches
from scex_sumo.metrics.pairs.scenes import Samples
from scex_sumo.metrics.registry import Metric, metrics_named


@dataclass(frozen=True, kw_only=True, eq=False)
class PairValues(Rows):
    """Nanoscopic values of one metric, one row per ordered pair (or vehicle) where defined."""

    future: IntArray
    step: IntArray  # on the step axis of the tracks, history included
    vehicle: IntArray
    other: IntArray | None  # the second vehicle; None for metrics of single vehicles
    value: FloatArray  # ``ttc`` in s, not inverted; inf is a value


def evaluate_pairs(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    preset: str = PAPER_PRESET,
    parameters: MetricParameters = PAPER,
    metrics: Sequence[str | Metric] | None = None,
) -> dict[str, PairValues]:
    """Evaluate all pairs by metric, sorted by future, step, vehicle, other; see `evaluate`."""
    chosen = metrics_named(metrics)
    parts: dict[str, list[PairValues]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned, preset=preset, parameters=parameters):
        for metric in chosen:
            samples = samples_of(metric, scenes, quick=False)
            parts[metric.name].append(_rows(dense(samples, scenes), start, tracks.first))
    return {name: PairValues.join(part) for name, part in parts.items()}


def _rows(samples: Samples, first_future: int, first_step: int) -> PairValues:
    entry, future, step = np.nonzero(samples.defined)
    value = samples.value[entry, future, step]
    vehicle = samples.row[entry]
    other = None if samples.other is None else samples.other[entry]
    if samples.symmetric and other is not None:
        vehicle, other = np.concatenate([vehicle, other]), np.concatenate([other, vehicle])
        future, step, value = np.tile(future, 2), np.tile(step, 2), np.tile(value, 2)
    keys = (vehicle, step, future) if other is None else (other, vehicle, step, future)
    rows = PairValues(
        future=future + first_future, step=step + first_step, vehicle=vehicle, other=other, value=value
    )
    return rows.take(np.lexsort(keys))
