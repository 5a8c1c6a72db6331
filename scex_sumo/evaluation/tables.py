"""Metric values as Arrow tables: per pair, per scene, per case or child, and where the worst came from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.reader import TrackTable
from scex_sumo.errors import UsageError
from scex_sumo.evaluation.blocks import Block, blocks
from scex_sumo.evaluation.cases import Cases
from scex_sumo.evaluation.outcomes import after_collision
from scex_sumo.evaluation.plans import StoredPlans
from scex_sumo.metrics.base import PAPER, MetricParameters
from scex_sumo.metrics.evaluate import ScenarioValues, evaluate, evaluate_pairs
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.outlines.collisions import Collisions, find_collisions
from scex_sumo.metrics.registry import metrics_named

Level: TypeAlias = Literal["pair", "scene", "scenario", "worst"]
LEVELS: Final[tuple[Level, ...]] = ("pair", "scene", "scenario", "worst")


def recording_table(
    table: TrackTable,
    *,
    level: str = "scenario",
    preset: str = "paper",
    parameters: MetricParameters = PAPER,
    metrics: Sequence[str | Metric] | None = None,
    history: int = 0,
    plans: StoredPlans | None = None,
    outcomes: bool = False,
) -> pa.Table:
    """Metric values of the motor vehicles of a recording or of child scenarios.

    Args:
        table: the tracks, taken as they are.
        level: ``pair``: case_id, timestamp_ms, metric, track_id, other_id, value, one row per ordered pair
            where defined (TTC in s); ``scene``: case_id, timestamp_ms, metric, value (TTC as 1/s);
            ``scenario``: case_id and two columns per metric; ``worst``: case_id, metric, timestamp_ms,
            track_id, other_id, value, where each scenario's extremum came from.
        preset: rule for car-following.
        parameters: constants.
        metrics: names, import paths or metrics; the paper's six by default.
        history: steps at the start of each case that are not evaluated.
        plans: what the vehicles planned, the cases being children; None takes the tracks driven.
        outcomes: the cases are children: tell whether they collide (``scenario``: collision), and which
            values are of two vehicles that had collided (``pair`` and ``worst``: after_collision).

    Raises:
        UsageError: an unknown level, preset or metric.
        ResultError: the plans are not those of the tracks.
    """
    if level not in LEVELS:
        raise UsageError(f"metrics: unknown level {level!r}; known: {', '.join(LEVELS)}")
    names = case_ids(table)
    chosen = metrics_named(metrics)
    order = tuple(metric.name for metric in chosen)
    options: dict[str, Any] = {"preset": preset, "parameters": parameters, "metrics": chosen}
    parts = list(blocks(table, history=history, plans=plans))
    if level == "pair":
        rows = [_pair_rows(block, order, options, outcomes=outcomes) for block in parts]
        return _sorted_pairs(rows, names, order)
    evaluated = [(block, evaluate(block.tracks, block.planned, **options)) for block in parts]
    if level == "scene":
        return _scene_table(evaluated, names, order)
    collected = Cases(len(names), chosen, outcomes=outcomes)
    for block, values in evaluated:
        collected.add(block, values)
    return collected.scenarios(names) if level == "scenario" else collected.origins(names)


def case_ids(table: TrackTable) -> pa.Array:
    """Ids of the cases, as whole numbers where they are; 1 for a recording without cases."""
    if not table.has_cases:
        return pa.array([1], pa.int64())
    try:
        numbers = [float(name) for name in table.cases]
    except ValueError:
        return pa.array(list(table.cases), pa.string())
    if all(number.is_integer() for number in numbers):
        return pa.array([int(number) for number in numbers], pa.int64())
    return pa.array(numbers, pa.float64())


def worst_table(
    values: ScenarioValues,
    *,
    child: Sequence[int] | IntArray,
    track_ids: IntArray,
    timestamp_ms: IntArray,
    hits: Collisions | None = None,
) -> pa.Table:
    """Where the extremum of every child and metric came from: ``worst.parquet`` of a result folder.

    Args:
        values: of C children.
        child: (C,) their numbers.
        track_ids: (V,) of the vehicles.
        timestamp_ms: (T,) of the steps, history included.
        hits: collisions of the same tracks; None for none.

    Returns:
        child, metric, timestamp_ms, track_id, other_id (null for single vehicles), value, after_collision
        (whether the two had collided by then); no row where undefined.
    """
    parts = []
    numbers = np.asarray(child, dtype=np.int64)
    for name, worst in values.worst.items():
        at = np.flatnonzero(worst.defined)
        other = None if worst.other is None else track_ids[worst.other[at]]
        rows = _rows_table(
            {"child": numbers[at]},
            name,
            timestamp_ms[worst.step[at]],
            track_ids[worst.vehicle[at]],
            other,
            worst.value[at],
            metric_first=True,
        )
        pair = worst.vehicle[at], None if worst.other is None else worst.other[at]
        after = np.zeros(len(at), dtype=np.bool_)
        if hits is not None:
            after = after_collision(hits, at, worst.step[at], *pair)
        parts.append(_flagged(rows, after))
    return pa.concat_tables(parts).sort_by([("child", "ascending")]) if parts else pa.table({})


def _flagged(rows: pa.Table, after: BoolArray) -> pa.Table:
    """The rows with a column that tells those of vehicles that had collided with each other."""
    return rows.append_column("after_collision", pa.array(after))


def _rows_table(
    lead: dict[str, Any],
    metric: str,
    timestamp_ms: IntArray,
    track_id: IntArray,
    other_id: IntArray | None,
    value: FloatArray,
    *,
    metric_first: bool = False,
) -> pa.Table:
    names = pa.repeat(pa.scalar(metric), len(value))
    time = {"metric": names, "timestamp_ms": timestamp_ms}
    if not metric_first:
        time = {"timestamp_ms": timestamp_ms, "metric": names}
    other = pa.nulls(len(value), pa.int64()) if other_id is None else pa.array(other_id, pa.int64())
    return pa.table({**lead, **time, "track_id": track_id, "other_id": other, "value": value})


def _pair_rows(
    block: Block, order: tuple[str, ...], options: dict[str, Any], *, outcomes: bool
) -> list[pa.Table]:
    """One table per metric with ``case`` as index."""
    hits = find_collisions(block.tracks) if outcomes else None
    found = evaluate_pairs(block.tracks, block.planned, **options)
    tables = []
    for name in order:
        rows = found[name]
        ids = block.track_id
        other = None if rows.other is None else ids[rows.child, rows.other]
        stamps = block.timestamp_ms[rows.child, rows.step]
        lead = {"case": block.case[rows.child]}
        table = _rows_table(lead, name, stamps, ids[rows.child, rows.vehicle], other, rows.value)
        if hits is not None:
            table = _flagged(table, after_collision(hits, rows.child, rows.step, rows.vehicle, rows.other))
        tables.append(table)
    return tables


def _sorted_pairs(parts: Iterable[list[pa.Table]], names: pa.Array, order: tuple[str, ...]) -> pa.Table:
    """Rows by case, time, metric (in the order of the columns), track and other."""
    tables = [table for part in parts for table in part]
    if not tables:
        tables = [_rows_table({"case": np.empty(0, np.int64)}, "", *_nothing())]
    whole = pa.concat_tables(tables)
    rank = np.concatenate([np.full(len(t), i % max(len(order), 1)) for i, t in enumerate(tables)])
    columns = [np.asarray(whole[name]) for name in ("track_id", "timestamp_ms", "case")]
    other = np.asarray(whole["other_id"].fill_null(0))
    whole = whole.take(pa.array(np.lexsort((other, columns[0], rank, columns[1], columns[2]))))
    return _named(whole, names)


def _nothing() -> tuple[IntArray, IntArray, None, FloatArray]:
    return np.empty(0, np.int64), np.empty(0, np.int64), None, np.empty(0)


def _named(table: pa.Table, names: pa.Array) -> pa.Table:
    """The index column ``case`` replaced by the ids."""
    return table.set_column(0, "case_id", names.take(table["case"].combine_chunks()))


def _scene_table(
    evaluated: list[tuple[Block, ScenarioValues]], names: pa.Array, order: tuple[str, ...]
) -> pa.Table:
    cases, times, ranks = ([np.empty(0, np.int64)] for _ in range(3))
    found = [np.empty(0)]
    for block, values in evaluated:
        stamps = block.timestamp_ms[:, block.tracks.first :]
        for rank, name in enumerate(order):
            scene = values.scene[name]
            child, step = np.nonzero(scene.defined)
            cases.append(block.case[child])
            times.append(stamps[child, step])
            ranks.append(np.full(len(child), rank))
            found.append(scene.value[child, step])
    case, stamp, which = (np.concatenate(parts) for parts in (cases, times, ranks))
    value = np.concatenate(found)
    by = np.lexsort((which, stamp, case))
    metric = pa.array(list(order), pa.string()).take(pa.array(which[by]))
    return pa.table(
        {
            "case_id": names.take(pa.array(case[by])),
            "timestamp_ms": stamp[by],
            "metric": metric,
            "value": value[by],
        }
    )
