"""Parts of a run: finished batches of futures, in a hidden folder until the run is finished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.files import remove_unfinished, replacing
from scex_sumo.scene import States

PARTS = ".parts"
TABLES = ("worst", "fallbacks", "collisions", "encounters", "horizons", "conflicts")
_ARRAYS = ("futures", "values", "defined", "tested")
_STATES = ("x", "y", "heading", "speed")


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Some futures of a run, simulated and measured; states as in `Rollout`.

    Attributes:
        plan_x: (C, V, 30) of the last plans, kept in memory alone; so ``plan_y``.
        values: (C, M) metric values.
        defined: (C, M) False where a metric is defined in no scene of the future.
        worst: rows of ``worst.parquet``; so ``fallbacks``, ``collisions``.
        tested: (C, 2, M) values, and 1 where defined, of the vehicles under test alone; None without any.
        encounters: rows of `Encounters` in `SMALL` types.
        horizons: rows of ``horizons.parquet``; None for short futures.
        conflicts: rows of ``conflicts.parquet``; None unless asked for.
    """

    futures: IntArray
    states: States
    values: FloatArray
    defined: BoolArray
    worst: pa.Table
    plan_x: FloatArray | None = None
    plan_y: FloatArray | None = None
    fallbacks: pa.Table | None = None
    tested: FloatArray | None = None
    collisions: pa.Table | None = None
    encounters: pa.Table | None = None
    horizons: pa.Table | None = None
    conflicts: pa.Table | None = None


def save_part(folder: Path, part: Part) -> None:
    """Save a batch of futures in a result folder."""
    target = folder / PARTS / f"{int(part.futures[0]):08d}-{int(part.futures[-1]):08d}.npz"
    arrays: dict[str, Any] = {name: array for name in _ARRAYS if (array := getattr(part, name)) is not None}
    arrays |= {name: _packed(table) for name in TABLES if (table := getattr(part, name)) is not None}
    with replacing(target) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays, **vars(part.states))


def remove_broken(folder: Path) -> None:
    """Remove damaged parts of an interrupted run; their futures run again."""
    remove_unfinished(folder / PARTS)
    for file in (folder / PARTS).glob("*.npz"):
        if not _is_whole(file):
            file.unlink()


def _is_whole(file: Path) -> bool:
    try:
        part = _loaded(file)
    except Exception:  # of zipfile, numpy or Arrow, by whatever bytes; or something is missing
        return False
    arrays = (part.futures, part.values, part.defined, part.tested, *vars(part.states).values())
    return len({len(array) for array in arrays if array is not None}) == 1


def _unpacked(data: NDArray[np.uint8]) -> pa.Table:
    return pa.ipc.open_stream(data.tobytes()).read_all()


def _packed(table: pa.Table) -> NDArray[np.uint8]:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return np.frombuffer(sink.getvalue(), dtype=np.uint8)


class Parts:
    """The parts in a result folder, read by future, whatever the batches."""

    def __init__(self, folder: Path) -> None:
        self._files = {file: np.load(file)["futures"] for file in sorted((folder / PARTS).glob("*.npz"))}
        self.futures = np.unique(np.concatenate([np.empty(0, np.int64), *self._files.values()]))
        """(C,) numbers of the finished futures, ascending."""

    def read(self, first: int, stop: int) -> Part:
        """Return futures ``first`` to ``stop - 1`` in order; they must be there."""
        left, parts = np.arange(first, stop), list[Part]()
        for file, futures in self._files.items():
            if (own := np.intersect1d(futures, left)).size:  # two files may have the same future
                parts.append(_loaded(file, own))
                left = np.setdiff1d(left, own)
        whole = joined_parts(parts)
        columns, order = dict(vars(whole)), np.argsort(whole.futures)
        for name, values in columns.items():
            if values is not None:
                columns[name] = _in_order(values) if name in TABLES else values[order]
        if whole.fallbacks is not None and not whole.fallbacks.num_rows:
            columns["fallbacks"] = None
        return Part(**columns)


def _loaded(file: Path, futures: IntArray | None = None) -> Part:
    """Return some futures of a file; None: all."""
    with file.open("rb") as opened, np.load(opened) as data:
        rows = slice(None) if futures is None else np.isin(data["futures"], futures)
        columns: dict[str, Any] = {name: data[name][rows] for name in _ARRAYS if name in data}
        columns["states"] = States(**{name: data[name][rows] for name in _STATES})
        mine = pa.array(columns["futures"])
        for name in TABLES:
            if name in data:
                table = _unpacked(data[name])
                columns[name] = table.filter(pc.is_in(table["future"], value_set=mine))
    return Part(**columns)


def joined_parts(parts: Sequence[Part]) -> Part:
    """Join parts of consecutive futures."""

    def joined(name: str) -> Any:
        there = [value for part in parts if (value := getattr(part, name)) is not None]
        if not there:
            return None
        if name in TABLES:
            return pa.concat_tables(there)
        return (States.concatenate if name == "states" else np.concatenate)(there, axis=0)

    return Part(**{field.name: joined(field.name) for field in fields(Part)})


def _in_order(table: pa.Table) -> pa.Table:
    """Return the rows ordered by future, and metric if they have it."""
    keys = [np.asarray(table[name]) for name in ("metric", "future") if name in table.column_names]
    return table.take(np.lexsort(keys))
