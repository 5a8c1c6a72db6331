"""States of all futures in a result folder, its seed scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import ResultError
from scex_sumo.converters.datasets.scene import take_scene
from scex_sumo.converters.registries import place_name
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.results.tables.reading import as_table, check_fit, read_table
from scex_sumo.scene import SeedScene, States

if TYPE_CHECKING:
    from scex_sumo.base.arrow import ArrowTable

_STATES = ("x", "y", "vx", "vy", "psi_rad")
MAX_STATE = 1e8
"""Limit of positions in m and all else, as in recordings."""


def read_states(file: Path, *, rows: int) -> ArrowTable:
    """Read ``tracks.parquet``; states are no larger than a recording's, and null after an arrival."""
    return _checked_states(file, read_table(file, columns=("case_id", "track_id", *_STATES), rows=rows))


def _checked_states(file: Path, table: ArrowTable) -> ArrowTable:
    for name in _STATES:
        numbers = pa.types.is_floating(table.schema.field(name).type)
        if not numbers or not (np.abs(np.asarray(table[name].fill_null(0.0))) <= MAX_STATE).all():
            raise ResultError(f"{file}: column {name} has impossible values; run again")
    return table


class StateBlocks:
    """States in ``tracks.parquet``, read a row group at a time to save memory."""

    def __init__(self, file: Path, *, futures: int, vehicles: int, frames: int) -> None:
        self._file, self._shape = file, (-1, vehicles, frames)
        rows = vehicles * frames
        with as_table(file):
            self._parquet = pq.ParquetFile(file.absolute())
            there = self._parquet.metadata
            groups = [there.row_group(index).num_rows for index in range(there.num_row_groups)]
        check_fit(file, self._parquet.schema_arrow.names, _STATES, there.num_rows, futures * rows)
        if any(size % rows for size in groups):
            raise ResultError(f"{file}: a future lies in two row groups; run again")
        self.ends = np.cumsum([size // rows for size in groups], dtype=np.int64)
        """Number of futures up to the end of each row group."""
        self._last: tuple[int, States] | None = None

    def read(self, block: int) -> States:
        """Return the states (C, V, T) of the futures of a row group, NaN after an arrival."""
        if self._last is None or self._last[0] != block:
            self._last = None
            with as_table(self._file):
                table = self._parquet.read_row_groups([block], columns=list(_STATES))
            _checked_states(self._file, table)
            x, y, vx, vy, psi = (np.asarray(table[name]).reshape(self._shape) for name in _STATES)
            self._last = block, States(x=x, y=y, heading=psi, speed=np.hypot(vx, vy))
        return self._last[1]

    def future(self, number: int) -> States:
        """Return the states (V, T) of a future."""
        block = int(np.searchsorted(self.ends, number, side="right"))
        states: States = self.read(block)[number - (int(self.ends[block - 1]) if block else 0)]
        return states


def read_scene(folder: Path, known: Mapping[str, Any]) -> SeedScene:
    """Read the seed scene from ``seed.csv``, with vehicles in the order of ``run.json``."""
    table = read_tracks(folder / "seed.csv", vehicles={str(track) for track in known["track_ids"]})
    name, place = known["name"], place_name(folder / known["name"])
    scene = take_scene(table, name=name, location=place, case="1.0", repair=False)
    where = {int(track): index for index, track in enumerate(scene.track_ids)}
    if sorted(where) != sorted(known["track_ids"]):
        raise ResultError(f"{folder}: seed.csv is not that of run.json; run again")
    scene = scene.reordered([where[track] for track in known["track_ids"]], name=known["name"])
    return replace(scene, source=known.get("source") or {})
