"""Outcomes of children as rows of tables: collisions, and encounters as the parts of a run keep them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, IntArray
from scex_sumo.metrics.outlines.collisions import KINDS, SIDES, Collisions
from scex_sumo.metrics.outlines.encounters import Encounters

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
    ]
)
"""``step``: the first one after the impact, which is at ``time_s``, both from the seed moment on."""

_SMALL = {"first": np.int32, "second": np.int32, "kind": np.int8, "towards": np.int8}


def collisions_table(found: Collisions, *, children: IntArray, track_ids: IntArray, first: int) -> pa.Table:
    """Collisions with the names of children and vehicles, sorted by child, time and pair.

    Args:
        found: of C children.
        children: (C,) their numbers.
        track_ids: (V,) of the vehicles.
        first: steps of history before the first evaluated one.

    Returns:
        Columns as ``COLLISIONS_SCHEMA``; ``track_id`` hits ``other_id`` in a rear-end collision.
    """
    kinds, sides = np.array(KINDS), np.array(SIDES)
    columns = {
        "child": np.asarray(children)[found.child],
        "step": found.step - first + 1,
        "time_s": found.time_s,
        "track_id": np.asarray(track_ids)[found.first],
        "other_id": np.asarray(track_ids)[found.second],
        "kind": kinds[found.kind],
        "side": sides[found.first_side],
        "other_side": sides[found.second_side],
        "relative_speed": found.relative_speed,
        "overlap": found.overlap,
        "x": found.x,
        "y": found.y,
    }
    return pa.table({name: pa.array(values) for name, values in columns.items()}, schema=COLLISIONS_SCHEMA)


def collided(table: pa.Table, children: IntArray) -> BoolArray:
    """(C,) whether each of some children has a collision in a table of them."""
    hit: BoolArray = np.isin(children, np.asarray(table["child"]))
    return hit


def encounter_rows(found: Encounters, children: IntArray) -> pa.Table:
    """Encounters of a batch as a table, a few dozen bytes a row; ``child`` are the children's numbers."""
    columns = {f.name: getattr(found, f.name) for f in fields(found)}
    columns["child"] = np.asarray(children, dtype=np.int64)[found.child]
    return pa.table({name: values.astype(_SMALL.get(name, values.dtype)) for name, values in columns.items()})


def encounters_of_rows(table: pa.Table) -> Encounters:
    """The encounters that `encounter_rows` made a table of; children count from 0."""
    columns: dict[str, Any] = {f.name: np.asarray(table[f.name]) for f in fields(Encounters)}
    return Encounters(**columns | {name: columns[name].astype(np.int64) for name in _SMALL})


def after_collision(
    hits: Collisions, child: IntArray, step: IntArray, vehicle: IntArray, other: IntArray | None
) -> BoolArray:
    """(N,) whether the two vehicles of a value had collided by its step; False for single vehicles.

    Args:
        hits: of the same tracks.
        child: (N,).
        step: (N,) index on the step axis of the tracks, as `Collisions` has it.
        vehicle: (N,).
        other: (N,) the second vehicle.
    """
    if other is None or len(hits) == 0:
        return np.zeros(len(child), dtype=np.bool_)
    count = int(max(vehicle.max(initial=0), other.max(initial=0), hits.first.max(), hits.second.max())) + 1

    def key(child: IntArray, one: IntArray, two: IntArray) -> IntArray:
        return (child * count + np.minimum(one, two)) * count + np.maximum(one, two)

    struck, at = np.unique(key(hits.child, hits.first, hits.second), return_index=True)
    wanted = key(child, vehicle, other)
    place = np.minimum(np.searchsorted(struck, wanted), len(struck) - 1)
    known: BoolArray = (struck[place] == wanted) & (step >= hits.step[at[place]])
    return known
