"""Outcomes of children as tables: collisions, and encounters of batches."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.evaluation.severity import Severity
from scex_sumo.metrics.collisions import KINDS, SIDES, Collisions
from scex_sumo.metrics.encounters import Encounters

COLLISIONS: Final = "collisions.parquet"
COLLISIONS_SCHEMA: Final = pa.schema(
    [
        ("child", pa.int64()),
        ("step", pa.int64()),
        ("time_s", pa.float64()),
        ("track_id", pa.int64()),
        ("other_id", pa.int64()),
        ("kind", pa.string()),
        ("side", pa.string()),
        ("other_side", pa.string()),
        *((name, pa.float64()) for name in ("relative_speed", "overlap", "x", "y")),
        *((name, pa.float64()) for name in ("delta_v", "delta_v_other", "p_mais3", "p_mais3_other")),
        ("fault", pa.string()),
    ]
)
"""``step`` is the first one after the impact at ``time_s``; both count from the seed moment. The last
five are those of `Severity`; ``p_mais3`` is null for types that the curve does not cover."""

_SMALL = {"first": np.int32, "second": np.int32, "kind": np.int8, "towards": np.int8}


def collisions_table(
    hits: Collisions, severity: Severity, *, children: IntArray, track_ids: IntArray, first: int
) -> pa.Table:
    """Tabulate the collisions of C children with numbers (C,), by child, time and pair.

    In a rear-end collision ``track_id`` hits ``other_id``.
    """
    kinds, sides = np.array(KINDS), np.array(SIDES)
    columns = {
        "child": np.asarray(children)[hits.child],
        "step": hits.step - first + 1,
        "time_s": hits.time_s,
        "track_id": np.asarray(track_ids)[hits.first],
        "other_id": np.asarray(track_ids)[hits.second],
        "kind": kinds[hits.kind],
        "side": sides[hits.first_side],
        "other_side": sides[hits.second_side],
        "relative_speed": hits.relative_speed,
        "overlap": hits.overlap,
        "x": hits.x,
        "y": hits.y,
        **{
            name: pa.array(getattr(severity, name), from_pandas=True)  # NaN is null
            for name in ("delta_v", "delta_v_other", "p_mais3", "p_mais3_other")
        },
        "fault": pa.array(severity.faults(), pa.string()),
    }
    return pa.table({name: pa.array(values) for name, values in columns.items()}, schema=COLLISIONS_SCHEMA)


def collided(table: pa.Table, children: IntArray) -> BoolArray:
    """Return (C,) whether children have a collision in the table."""
    hit: BoolArray = np.isin(children, np.asarray(table["child"]))
    return hit


def encounter_rows(encounters: Encounters, children: IntArray) -> pa.Table:
    """Tabulate the encounters of a batch in small types, with the child's number."""
    columns = {f.name: getattr(encounters, f.name) for f in fields(encounters)}
    columns["child"] = np.asarray(children, dtype=np.int64)[encounters.child]
    return pa.table({name: values.astype(_SMALL.get(name, values.dtype)) for name, values in columns.items()})


def encounters_of_rows(table: pa.Table) -> Encounters:
    """Return the encounters of a table of `encounter_rows`."""
    columns: dict[str, Any] = {f.name: np.asarray(table[f.name]) for f in fields(Encounters)}
    return Encounters(**columns | {name: columns[name].astype(np.int64) for name in _SMALL})


def after_collision(
    hits: Collisions, child: IntArray, step: IntArray, vehicle: IntArray, other: IntArray | None
) -> BoolArray:
    """Return (N,) whether two vehicles had collided by a step; False for single vehicles.

    ``step`` (N,) is on the step axis of the tracks.
    """
    if other is None or len(hits) == 0:
        return np.zeros(len(child), dtype=np.bool_)
    count = int(max(vehicle.max(initial=0), other.max(initial=0), hits.first.max(), hits.second.max())) + 1

    def key(child: IntArray, one: IntArray, two: IntArray) -> IntArray:
        return (child * count + np.minimum(one, two)) * count + np.maximum(one, two)

    struck, at = np.unique(key(hits.child, hits.first, hits.second), return_index=True)
    wanted = key(child, vehicle, other)
    place = np.minimum(np.searchsorted(struck, wanted), len(struck) - 1)
    after: BoolArray = (struck[place] == wanted) & (step >= hits.step[at[place]])
    return after
