"""Metric values as Arrow tables: per pair, scene, case or future, and the origin of extrema."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, IntArray, Rows
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.evaluation.blocks import Block, blocks
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import ScenarioValues, dense, evaluate, samples_of, scene_batches
from scex_sumo.metrics.extrema import scene_sums
from scex_sumo.metrics.pairs.scenes import Samples
from scex_sumo.metrics.registry import Metric, metrics_named
from scex_sumo.results.tables.outcomes import other_ids

LEVELS: Final = ("pair", "scene", "scenario")


def recording_table(
    table: TrackTable,
    *,
    level: str = "scenario",
    metrics: Sequence[str | Metric] | None = None,
    history: int = 0,
) -> pa.Table:
    """Evaluate metrics of the motor vehicles of a recording or of futures.

    Args:
        level: ``pair``: case_id, timestamp_ms, metric, track_id, other_id, value, one row per ordered pair
            where defined (TTC in s); ``scene``: case_id, timestamp_ms, metric, value (TTC as 1/s);
            ``scenario``: case_id and two columns per metric.
        metrics: names, import paths or metrics; default: the paper's six.
        history: steps at the start of each case without evaluation.

    Raises:
        UsageError: an unknown level or metric.
    """
    if level not in LEVELS:
        raise UsageError(f"metrics: unknown level {level!r}; known: {', '.join(LEVELS)}")
    names = case_ids(table)
    chosen = metrics_named(metrics)
    parts = blocks(table, history=history)
    if level == "scenario":
        evaluated = [(block, evaluate(block.tracks, block.planned, metrics=chosen)) for block in parts]
        return _scenario_table(evaluated, names, chosen)
    rows_of, ids = (_scene_rows, ()) if level == "scene" else (_pair_rows, ("track_id", "other_id"))
    by = ("case", "timestamp_ms", "metric", *ids)
    empty = pa.schema(dict.fromkeys(by, pa.int64()) | {"value": pa.float64()}).empty_table()
    filled = (pa.table(rows) for block in parts for rows in rows_of(block, chosen))
    result = pa.concat_tables([empty, *filled]).sort_by([(name, "ascending") for name in by])
    words = pa.array([metric.name for metric in chosen], pa.string())
    result = result.set_column(2, "metric", words.take(result["metric"].combine_chunks()))
    return result.set_column(0, "case_id", names.take(result["case"].combine_chunks()))


def case_ids(table: TrackTable) -> pa.Array:
    """Return case ids, as whole numbers if possible; 1 for a recording without cases."""
    if not table.has_cases:
        return pa.array([1], pa.int64())
    try:
        numbers = [float(name) for name in table.cases]
    except ValueError:
        return pa.array(list(table.cases), pa.string())
    if all(number.is_integer() and abs(number) < 2**53 for number in numbers):
        return pa.array([int(number) for number in numbers], pa.int64())
    return pa.array(numbers, pa.float64())


def _pair_rows(block: Block, metrics: Sequence[Metric]) -> Iterator[dict[str, Any]]:
    values, ids = evaluate_pairs(block.tracks, block.planned, metrics=metrics), block.track_id
    for rank, metric in enumerate(metrics):
        rows = values[metric.name]
        yield {
            "case": block.case[rows.future],
            "timestamp_ms": block.timestamp_ms[rows.future, rows.step],
            "metric": np.full(len(rows.value), rank),
            "track_id": ids[rows.future, rows.vehicle],
            "other_id": other_ids(
                None if rows.other is None else ids[rows.future, rows.other], len(rows.value)
            ),
            "value": rows.value,
        }


def _scene_rows(block: Block, metrics: Sequence[Metric]) -> Iterator[dict[str, Any]]:
    values = evaluate(block.tracks, block.planned, metrics=metrics)
    for rank, metric in enumerate(metrics):
        scene = values.scene[metric.name]
        future, step = np.nonzero(scene.defined)
        yield {
            "case": block.case[future],
            "timestamp_ms": block.timestamp_ms[future, block.tracks.first + step],
            "metric": np.full(len(future), rank),
            "value": scene.value[future, step],
        }


def _scenario_table(
    evaluated: Sequence[tuple[Block, ScenarioValues]], names: pa.Array, metrics: Sequence[Metric]
) -> pa.Table:
    """Return extrema and means of whole cases, collected block by block."""
    size = len(names), len(metrics)
    value, (total, counted, scenes) = np.full(size, np.nan), np.zeros((3, *size))
    for block, values in evaluated:
        for column, metric in enumerate(metrics):
            scene, worst = values.scene[metric.name], values.worst[metric.name]
            count, sums = scene_sums(scene, harmonic=metric.harmonic)
            np.add.at(total[:, column], block.case, sums)
            np.add.at(counted[:, column], block.case, count)
            np.add.at(scenes[:, column], block.case, scene.defined.sum(axis=1))
            case = block.case[worst.defined]
            worse = np.fmin if metric.critical == "min" else np.fmax
            value[case, column] = worse(value[case, column], worst.value[worst.defined])
    columns: dict[str, Any] = {"case_id": names}
    for column, metric in enumerate(metrics):
        undefined, over, under = scenes[:, column] == 0, total[:, column], counted[:, column]
        if metric.harmonic:
            over, under = under, over
        mean = over / np.where(undefined, 1.0, under)
        columns[metric.name] = pa.array(value[:, column], mask=undefined)
        columns[f"{metric.name}_mean"] = pa.array(mean, mask=undefined)
    return pa.table(columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class PairValues(Rows):
    """Nanoscopic values of one metric, one row per ordered pair (or vehicle) where defined."""

    future: IntArray
    step: IntArray  # on the step axis of the tracks, history included
    vehicle: IntArray
    other: IntArray | None  # the second vehicle; None for metrics of single vehicles
    value: FloatArray  # ``ttc`` in s, not inverted; inf is a value


def evaluate_pairs(
    tracks: SceneTracks, planned: PlannedPaths | None, *, metrics: Sequence[str | Metric] | None = None
) -> dict[str, PairValues]:
    """Evaluate all pairs by metric, sorted by future, step, vehicle, other; see `evaluate`."""
    chosen = metrics_named(metrics)
    values: dict[str, list[PairValues]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned):
        for metric in chosen:
            samples = samples_of(metric, scenes, quick=False)
            values[metric.name].append(_rows(dense(samples, scenes), start, tracks.first))
    return {name: PairValues.join(batches) for name, batches in values.items()}


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
