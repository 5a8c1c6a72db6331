"""Origin of each future's extrema as a table: ``worst.parquet``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.metrics.collisions import Collisions
from scex_sumo.metrics.evaluate import ScenarioValues
from scex_sumo.results.tables.outcomes import after_collision


def worst_table(
    values: ScenarioValues,
    *,
    future: Sequence[int] | IntArray,
    track_ids: IntArray,
    timestamp_ms: IntArray,
    hits: Collisions | None = None,
) -> pa.Table:
    """Tabulate the origin of each future's extrema: ``worst.parquet``.

    Args:
        future: (C,) numbers.
        track_ids: (V,).
        timestamp_ms: (T,) history included.

    Returns:
        future, metric, timestamp_ms, track_id, other_id (null for single vehicles), value, after_collision
        (whether the two had collided by then); no row where undefined.
    """
    parts = []
    numbers = np.asarray(future, dtype=np.int64)
    for name, worst in values.worst.items():
        at = np.flatnonzero(worst.defined)
        rows = worst.take(at)
        after = np.zeros(len(at), dtype=np.bool_)
        if hits is not None:
            after = after_collision(hits, at, rows.step, rows.vehicle, rows.other)
        columns = {
            "future": numbers[at],
            "metric": pa.repeat(pa.scalar(name), len(at)),
            "timestamp_ms": timestamp_ms[rows.step],
            "track_id": track_ids[rows.vehicle],
            "other_id": other_ids(None if rows.other is None else track_ids[rows.other], len(at)),
            "value": rows.value,
            "after_collision": pa.array(after),
        }
        parts.append(pa.table(columns))
    return pa.concat_tables(parts).sort_by([("future", "ascending")]) if parts else pa.table({})


def other_ids(ids: IntArray | None, count: int) -> pa.Array:
    """Column of the second vehicles' ids; null everywhere for a metric of single vehicles."""
    return pa.nulls(count, pa.int64()) if ids is None else pa.array(ids, pa.int64())
