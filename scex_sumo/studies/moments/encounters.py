"""Pairs of a moment of a recording, and encounters: two road users in consecutive moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.decision.decide import is_to_be_tested
from scex_sumo.decision.moment import human_part, pairs_of_part
from scex_sumo.decision.typology import kinds_of
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.pairs import PAIRS as DECIDED
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import MomentRef, as_row

PAIRS = pa.schema([*DECIDED, *schema("to_test conflict")])
"""Columns of pairs; ``conflict`` is one of `typology.CONFLICTS`, null where nobody asks for it."""
_PLACE: Final = ("location", "recording", "case", "seed", "time_s")
_CONSECUTIVE = 1.5  # times between two moments of one encounter, over the time between two moments

_FIRST = schema("track_id other_id what", _PLACE, "first_s last_s moments")
ENCOUNTERS: Final = pa.schema(
    [*_FIRST, *(field for field in PAIRS if field.name not in [*_FIRST.names, "doubt"]), *schema("doubt")]
)


Pairs: TypeAlias = Sequence[tuple[MomentRef, pa.Table]]
"""Moments, and their pairs as of `pairs_of_moment`."""


def encounters_of(pairs: Pairs, every_s: float) -> pa.Table:
    """Return the encounters of a data set, see `ENCOUNTERS`.

    The same two in consecutive moments are one encounter: its row is that of the moment with the largest P
    whose data are not doubtful.

    Args:
        every_s: time between two moments.
    """
    rows = pa.concat_tables([PAIRS.empty_table(), *(table for _, table in pairs)]).combine_chunks()
    if not len(rows):
        return ENCOUNTERS.empty_table()
    refs = pa.Table.from_pylist([as_row(ref) for ref, _ in pairs]).select([*_PLACE])
    refs = refs.take(np.repeat(np.arange(len(pairs)), [len(table) for _, table in pairs]))
    order, begins = _grouped(rows, refs, _CONSECUTIVE * every_s)
    time, starts = np.asarray(refs["time_s"])[order], np.flatnonzero(begins)
    columns_of = {name: rows[name] for name in PAIRS.names} | {name: refs[name] for name in _PLACE}
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.cumsum(begins) - 1
    worst = np.lexsort((-np.asarray(rows["probability"]), np.asarray(pc.is_valid(rows["doubt"])), group))
    best = worst[np.searchsorted(group[worst], np.arange(len(starts)))]  # without doubt first, then by P
    columns_of = {name: column.take(best) for name, column in columns_of.items()}
    columns_of |= {
        "first_s": pa.array(np.minimum.reduceat(time, starts)),
        "last_s": pa.array(np.maximum.reduceat(time, starts)),
        "moments": pa.array(np.diff(starts, append=len(order))),
    }
    missing = pa.nulls(len(starts))
    columns = [columns_of.get(field.name, missing).cast(field.type) for field in ENCOUNTERS]
    return pa.table(columns, schema=ENCOUNTERS)


def _grouped(rows: pa.Table, refs: pa.Table, apart_s: float) -> tuple[IntArray, BoolArray]:
    """Return an order (n,) that joins the rows of each encounter, and which one of the order begins one."""
    people = rows["person"].combine_chunks().dictionary_encode().indices
    other = pc.if_else(pc.is_valid(people), pc.subtract(-1, people), rows["other_id"])
    pair = np.sort([np.asarray(ids).astype(np.int64) for ids in (rows["track_id"], other)], axis=0)
    record = pc.binary_join_element_wise(refs["recording"], refs["case"], "\n").combine_chunks()
    keys = np.stack([np.asarray(record.dictionary_encode().indices), *pair])
    time = np.asarray(refs["time_s"])
    order = np.lexsort((time, *keys))
    differs = (np.diff(keys[:, order], axis=1) != 0).any(axis=0) | (np.diff(time[order]) > apart_s)
    return order, np.concatenate([[True], differs])


def with_columns(table: pa.Table, columns: Mapping[str, Sequence[Any]]) -> pa.Table:
    """Return a table with other values in some of its columns."""
    for name, values in columns.items():
        field = table.schema.field(name)
        table = table.set_column(table.schema.get_field_index(name), field, pa.array(values, field.type))
    return table


def pairs_of_moment(scene: SeedScene, net: SumoNet, *, futures: int, seed: int = 0) -> pa.Table:
    """Return the pairs of a ruled scene with a road, see `PAIRS`, the most probable contact first."""
    human = human_part(scene, net, futures=futures, seed=seed)
    table = pairs_of_part(scene, human)
    pairs = table.select(["track_id", "other_id", "probability", "future"]).to_pylist()
    table = table.append_column("to_test", pa.array([is_to_be_tested(pair) for pair in pairs], pa.bool_()))
    return table.append_column("conflict", pa.array(kinds_of(scene, pairs, human), pa.string()))
