"""Tables of a result folder, checked, because files are edited or truncated."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import ResultError, UsageError, one_line
from scex_sumo.metrics.registry import COLLISION, metric_of
from scex_sumo.scene import SeedScene, States

_STATES = ("x", "y", "vx", "vy", "psi_rad")
MAX_STATE = 1e8
"""Limit of positions in m and all else, as in recordings."""


@contextmanager
def as_table(file: Path) -> Iterator[None]:
    """Turn errors of reading a Parquet file into a `ResultError`."""
    try:
        yield
    except (OSError, pa.ArrowException, ValueError) as error:
        raise ResultError(f"{file}: cannot be read: {one_line(error)[:160]}") from None


def read_table(file: Path, *, columns: Sequence[str] = (), rows: int | None = None) -> pa.Table:
    """Read a Parquet file of a result, as `Run.table`."""
    with as_table(file):
        table = pq.ParquetFile(file.absolute()).read()  # a relative one may be a URI to Arrow
    _check_fit(file, table.column_names, columns, table.num_rows, rows)
    return table


def read_metrics(file: Path, *, rows: int | None) -> pa.Table:
    """Read ``metrics.parquet``: futures in order, and numbers of known metrics."""
    table = read_table(file, columns=("future",), rows=rows)
    if table["future"].to_pylist() != list(range(table.num_rows)):
        raise ResultError(f"{file}: its futures are not 0 to {table.num_rows - 1}; run again")
    for name in table.column_names[1:]:
        kind = table.schema.field(name).type
        if name == COLLISION and pa.types.is_boolean(kind) and not table[name].null_count:
            continue
        if not (pa.types.is_floating(kind) or pa.types.is_null(kind)):
            raise ResultError(f"{file}: column {name[:40]} holds no numbers; run again")
        try:
            metric_of(name)
        except UsageError:
            raise ResultError(
                f"{file}: column {name[:40]!r} is no metric that run.json describes; run again"
            ) from None
    return table


def read_assignments(file: Path, *, rows: int) -> pa.Table:
    """Read ``assignments.parquet``."""
    table = read_table(file, columns=("future", "track_id", "model"), rows=rows)
    if not pa.types.is_string(table.schema.field("model").type) or table["model"].null_count:
        raise ResultError(f"{file}: column model holds no names; run again")
    return table


def read_states(file: Path, *, rows: int) -> pa.Table:
    """Read ``tracks.parquet``, with finite states no larger than those of a recording."""
    return _checked_states(file, read_table(file, columns=("case_id", "track_id", *_STATES), rows=rows))


def _checked_states(file: Path, table: pa.Table) -> pa.Table:
    for name in _STATES:
        numbers = pa.types.is_floating(table.schema.field(name).type)
        if not numbers or not (np.abs(np.asarray(table[name])) <= MAX_STATE).all():
            raise ResultError(f"{file}: column {name} has impossible values; run again")
    return table


def _check_fit(
    file: Path, columns: Sequence[str], wanted: Sequence[str], rows: int, said: int | None
) -> None:
    missing = [column for column in wanted if column not in columns]
    if missing:
        raise ResultError(
            f"{file}: column {missing[0]} is missing; the file was edited or damaged: run again"
        )
    if said not in (None, rows):
        raise ResultError(f"{file}: has {rows} rows, run.json says {said}; run again")


class StateBlocks:
    """States in ``tracks.parquet``, read a row group at a time to save memory."""

    def __init__(self, file: Path, *, futures: int, vehicles: int, frames: int) -> None:
        self._file, self._shape = file, (-1, vehicles, frames)
        rows = vehicles * frames
        with as_table(file):
            self._parquet = pq.ParquetFile(file.absolute())
            there = self._parquet.metadata
            groups = [there.row_group(index).num_rows for index in range(there.num_row_groups)]
        _check_fit(file, self._parquet.schema_arrow.names, _STATES, there.num_rows, futures * rows)
        self._whole = any(size % rows for size in groups)  # a future lies in two groups
        groups = [there.num_rows] if self._whole else groups
        self.ends = np.cumsum([size // rows for size in groups], dtype=np.int64)
        """Number of futures up to the end of each row group."""
        self._last: tuple[int, States] | None = None

    def read(self, block: int) -> States:
        """Return the states (C, V, T) of the futures of a row group."""
        if self._last is None or self._last[0] != block:
            self._last = None
            with as_table(self._file):
                blocks = range(self._parquet.num_row_groups) if self._whole else [block]
                table = self._parquet.read_row_groups(blocks, columns=list(_STATES))
            _checked_states(self._file, table)
            x, y, vx, vy, psi = (np.asarray(table[name]).reshape(self._shape) for name in _STATES)
            self._last = block, States(x=x, y=y, heading=psi, speed=np.hypot(vx, vy))
        return self._last[1]

    def future(self, number: int) -> States:
        """Return the states (V, T) of a future."""
        block = int(np.searchsorted(self.ends, number, side="right"))
        states: States = self.read(block)[number - (int(self.ends[block - 1]) if block else 0)]
        return states


def with_own_collisions(table: pa.Table, collisions: pa.Table, vehicles: Iterable[str]) -> pa.Table:
    """Add the column ``collision`` of some vehicles to the metrics of their pairs."""
    own = [int(track) for track in vehicles]
    either = [np.isin(np.asarray(collisions[name]), own) for name in ("track_id", "other_id")]
    struck = np.asarray(collisions["future"])[either[0] | either[1]]
    hit = np.isin(np.asarray(table["future"]), struck).astype(np.float64)
    return table.add_column(1, COLLISION, pa.array(hit))


def own_injuries(collisions: pa.Table, vehicles: Iterable[str], futures: int) -> FloatArray:
    """Return (C,) expected severe injuries in the collisions of some vehicles."""
    own = np.array([int(track) for track in vehicles])
    mine = np.isin([np.asarray(collisions[name]) for name in ("track_id", "other_id")], own).any(axis=0)
    risks = [np.asarray(collisions[name].fill_null(0.0)) for name in ("p_mais3", "p_mais3_other")]
    future, risk = np.asarray(collisions["future"])[mine], np.sum(risks, axis=0)[mine]
    return np.bincount(future, risk, minlength=futures).astype(np.float64)


def read_scene(folder: Path, known: Mapping[str, Any]) -> SeedScene:
    """Read the seed scene from ``seed.csv``, with vehicles in the order of ``run.json``."""
    from scex_sumo.converters.datasets.scene import CleanRecording, take_scene
    from scex_sumo.converters.registries import place_name
    from scex_sumo.converters.tracks.reader import read_tracks

    table = read_tracks(folder / "seed.csv", vehicles={str(track) for track in known["track_ids"]})
    clean = CleanRecording(table=table, findings=(), repair=False)
    scene = take_scene(clean, name=known["name"], location=place_name(folder / known["name"]), case="1.0")
    where = {int(track): index for index, track in enumerate(scene.track_ids)}
    if sorted(where) != sorted(known["track_ids"]):
        raise ResultError(f"{folder}: seed.csv is not that of run.json; run again")
    return scene.reordered([where[track] for track in known["track_ids"]], name=known["name"])


def as_xarray(states: States, models: NDArray[np.str_], **vehicle_and_step: Any) -> Any:
    """Return an xarray data set of states (C, V, T) and models (C, V); a `UsageError` without xarray."""
    if importlib.util.find_spec("xarray") is None:
        raise UsageError("to_xarray needs xarray: pip install xarray")
    import xarray

    axes = ("future", "vehicle", "step")
    arrays: dict[str, Any] = {name: (axes, values) for name, values in vars(states).items()}
    arrays["model"] = axes[:2], models
    return xarray.Dataset(arrays, coords={"future": np.arange(len(models)), **vehicle_and_step})


def as_pandas(table: pa.Table) -> Any:
    """Return a pandas data frame; raise a `UsageError` without pandas."""
    if importlib.util.find_spec("pandas") is None:
        raise UsageError("to_pandas needs pandas: pip install 'scex-sumo[notebook]'")
    return table.to_pandas()
