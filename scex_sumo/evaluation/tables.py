"""Metric values as Arrow tables: per pair, scene, case or future, and the origin of extrema."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.evaluation.blocks import Block, blocks
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, Collisions, find_collisions
from scex_sumo.metrics.evaluate import (
    ScenarioValues,
    dense,
    evaluate,
    samples_of,
    scene_batches,
)
from scex_sumo.metrics.extrema import Worst, scene_sums
from scex_sumo.metrics.pairs.scenes import Samples
from scex_sumo.metrics.registry import Metric, metrics_named
from scex_sumo.results.tables.outcomes import after_collision, other_ids

Level: TypeAlias = Literal["pair", "scene", "scenario", "worst"]
LEVELS: Final[tuple[Level, ...]] = ("pair", "scene", "scenario", "worst")


def recording_table(
    table: TrackTable,
    *,
    level: str = "scenario",
    metrics: Sequence[str | Metric] | None = None,
    history: int = 0,
    outcomes: bool = False,
) -> pa.Table:
    """Evaluate metrics of the motor vehicles of a recording or of futures.

    Args:
        level: ``pair``: case_id, timestamp_ms, metric, track_id, other_id, value, one row per ordered pair
            where defined (TTC in s); ``scene``: case_id, timestamp_ms, metric, value (TTC as 1/s);
            ``scenario``: case_id and two columns per metric; ``worst``: columns as ``pair``, one row per case
            and metric.
        metrics: names, import paths or metrics; default: the paper's six.
        history: steps at the start of each case without evaluation.
        outcomes: add collision (``scenario``) or after_collision (``pair``, ``worst``).

    Raises:
        UsageError: an unknown level or metric.
    """
    if level not in LEVELS:
        raise UsageError(f"metrics: unknown level {level!r}; known: {', '.join(LEVELS)}")
    names = case_ids(table)
    chosen = metrics_named(metrics)
    parts = list(blocks(table, history=history))
    if level == "pair":
        tables = [rows for block in parts for rows in _pair_rows(block, chosen, outcomes=outcomes)]
        return _sorted_pairs(tables, names, len(chosen))
    evaluated = [(block, evaluate(block.tracks, block.planned, metrics=chosen)) for block in parts]
    if level == "scene":
        return _scene_table(evaluated, names, chosen)
    cases = _Cases(len(names), chosen, outcomes=outcomes)
    for block, values in evaluated:
        cases.add(block, values)
    return cases.scenarios(names) if level == "scenario" else cases.origins(names)


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


def _pair_rows(block: Block, metrics: Sequence[Metric], *, outcomes: bool) -> list[pa.Table]:
    hits = find_collisions(block.tracks, limit_m2=CONTACT_M2) if outcomes else None
    values = evaluate_pairs(block.tracks, block.planned, metrics=metrics)
    tables = []
    for metric in metrics:
        rows, ids = values[metric.name], block.track_id
        columns = {
            "case": block.case[rows.future],
            "timestamp_ms": block.timestamp_ms[rows.future, rows.step],
            "metric": pa.repeat(pa.scalar(metric.name), len(rows.value)),
            "track_id": ids[rows.future, rows.vehicle],
            "other_id": other_ids(
                None if rows.other is None else ids[rows.future, rows.other], len(rows.value)
            ),
            "value": rows.value,
        }
        if hits is not None:
            flags = after_collision(hits, rows.future, rows.step, rows.vehicle, rows.other)
            columns["after_collision"] = pa.array(flags)
        tables.append(pa.table(columns))
    return tables


def _sorted_pairs(tables: Sequence[pa.Table], names: pa.Array, metrics: int) -> pa.Table:
    if not tables:
        types = {"case": pa.int64(), "timestamp_ms": pa.int64(), "metric": pa.string()}
        types |= {"track_id": pa.int64(), "other_id": pa.int64(), "value": pa.float64()}
        tables = [pa.schema(types).empty_table()]
    whole = pa.concat_tables(tables)
    rank = np.concatenate([np.full(len(t), i % max(metrics, 1)) for i, t in enumerate(tables)])
    track, stamp, case = (np.asarray(whole[name]) for name in ("track_id", "timestamp_ms", "case"))
    other = np.asarray(whole["other_id"].fill_null(0))
    whole = whole.take(pa.array(np.lexsort((other, track, rank, stamp, case))))
    return whole.set_column(0, "case_id", names.take(whole["case"].combine_chunks()))


def _scene_table(
    evaluated: Sequence[tuple[Block, ScenarioValues]], names: pa.Array, metrics: Sequence[Metric]
) -> pa.Table:
    columns: list[list[FloatArray | IntArray]] = [[np.empty(0, np.int64)] for _ in range(3)]
    columns.append([np.empty(0)])
    for block, values in evaluated:
        stamps = block.timestamp_ms[:, block.tracks.first :]
        for rank, metric in enumerate(metrics):
            scene = values.scene[metric.name]
            future, step = np.nonzero(scene.defined)
            rows = (
                block.case[future],
                stamps[future, step],
                np.full(len(future), rank),
                scene.value[future, step],
            )
            for column, part in zip(columns, rows, strict=True):
                column.append(part)
    case, stamp, which, value = (np.concatenate(parts) for parts in columns)
    by = np.lexsort((which, stamp, case))
    metric_names = pa.array([metric.name for metric in metrics], pa.string())
    return pa.table(
        {
            "case_id": names.take(pa.array(case[by])),
            "timestamp_ms": stamp[by],
            "metric": metric_names.take(pa.array(which[by])),
            "value": value[by],
        }
    )


class _Cases:
    """Extrema and means of whole cases, collected block by block."""

    def __init__(self, count: int, metrics: Sequence[Metric], *, outcomes: bool) -> None:
        size = len(metrics)
        self.metrics, self.outcomes = metrics, outcomes
        self.collided, self.after = np.zeros(count, dtype=np.bool_), np.zeros((count, size), dtype=np.bool_)
        self.of_single_vehicles = np.zeros(size, dtype=bool)
        self.value = np.full((count, size), np.nan)
        self.total, self.counted, self.scenes = (np.zeros((count, size)) for _ in range(3))
        self.origin = np.zeros((count, size, 3), dtype=np.int64)

    def add(self, block: Block, values: ScenarioValues) -> None:
        hits = find_collisions(block.tracks, limit_m2=CONTACT_M2) if self.outcomes else None
        if hits is not None:
            self.collided[block.case[np.unique(hits.future)]] = True
        for column, metric in enumerate(self.metrics):
            scene, worst = values.scene[metric.name], values.worst[metric.name]
            count, total = scene_sums(scene, harmonic=metric.harmonic)
            np.add.at(self.total[:, column], block.case, total)
            np.add.at(self.counted[:, column], block.case, count)
            np.add.at(self.scenes[:, column], block.case, scene.defined.sum(axis=1))
            self._keep_worse(column, block, worst, hits)

    def _keep_worse(self, column: int, block: Block, worst: Worst, hits: Collisions | None) -> None:
        now = self.value[block.case, column]
        is_min = self.metrics[column].critical == "min"
        worse: BoolArray = worst.value < now if is_min else worst.value > now
        at = np.flatnonzero(worst.defined & (np.isnan(now) | worse))
        case, ids, rows = block.case[at], block.track_id, worst.take(at)
        self.of_single_vehicles[column] = rows.other is None
        other = rows.vehicle if rows.other is None else rows.other
        self.value[case, column] = rows.value
        if hits is not None:
            self.after[case, column] = after_collision(hits, at, rows.step, rows.vehicle, rows.other)
        self.origin[case, column] = np.stack(
            [block.timestamp_ms[at, rows.step], ids[at, rows.vehicle], ids[at, other]], axis=1
        )

    def scenarios(self, names: pa.Array) -> pa.Table:
        columns: dict[str, Any] = {"case_id": names}
        for column, metric in enumerate(self.metrics):
            undefined = self.scenes[:, column] == 0
            over, under = self.total[:, column], self.counted[:, column]
            if metric.harmonic:
                over, under = under, over
            mean = over / np.where(undefined, 1.0, under)
            columns[metric.name] = pa.array(self.value[:, column], mask=undefined)
            columns[f"{metric.name}_mean"] = pa.array(mean, mask=undefined)
        return pa.table(columns | ({"collision": pa.array(self.collided)} if self.outcomes else {}))

    def origins(self, names: pa.Array) -> pa.Table:
        case, column = np.nonzero(self.scenes > 0)
        metric_names = pa.array([metric.name for metric in self.metrics], pa.string())
        stamp, track, other = self.origin[case, column].T
        flag = {"after_collision": pa.array(self.after[case, column])} if self.outcomes else {}
        return pa.table(
            {
                "case_id": names.take(pa.array(case)),
                "metric": metric_names.take(pa.array(column)),
                "timestamp_ms": stamp,
                "track_id": track,
                "other_id": pa.array(other, mask=self.of_single_vehicles[column]),
                "value": self.value[case, column],
                **flag,
            }
        )


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
    metrics: Sequence[str | Metric] | None = None,
) -> dict[str, PairValues]:
    """Evaluate all pairs by metric, sorted by future, step, vehicle, other; see `evaluate`."""
    chosen = metrics_named(metrics)
    parts: dict[str, list[PairValues]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned):
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
