"""Tables of a result folder, read and checked: folders are edited, cut short, and of other programs."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.errors import ResultError, UsageError, one_line
from scex_sumo.metrics.registry import COLLISION, metric_of
from scex_sumo.scene import SeedScene, States

LARGEST_STATE = 1e8
"""Of positions in m and all else; larger ones are refused in recordings, too."""


def read_table(file: Path, *, columns: Sequence[str] = (), rows: int | None = None) -> pa.Table:
    """A Parquet file of a result; arguments and errors as `Run.table`."""
    try:
        table = pq.ParquetFile(file).read()
    except (OSError, pa.ArrowException, ValueError) as error:
        raise ResultError(f"{file}: cannot be read: {one_line(error)[:160]}") from None
    missing = [column for column in columns if column not in table.column_names]
    if missing:
        raise ResultError(f"{file}: has no column {missing[0]}; it is not as the run wrote it: run again")
    if rows not in (None, table.num_rows):
        raise ResultError(f"{file}: has {table.num_rows} rows, run.json says {rows}; run again")
    return table


def read_metrics(file: Path, *, rows: int | None) -> pa.Table:
    """``metrics.parquet``: children in order, and numbers of known metrics."""
    table = read_table(file, columns=("child",), rows=rows)
    if table["child"].to_pylist() != list(range(table.num_rows)):
        raise ResultError(f"{file}: its children are not 0 to {table.num_rows - 1}; run again")
    for name in table.column_names[1:]:
        if name == COLLISION:
            continue
        kind = table.schema.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_null(kind)):
            raise ResultError(f"{file}: column {name[:40]} holds no numbers; run again")
        metric_of(name)
    return table


def read_assignments(file: Path, *, rows: int) -> pa.Table:
    """``assignments.parquet``: models by their names."""
    table = read_table(file, columns=("child", "track_id", "model"), rows=rows)
    if not pa.types.is_string(table.schema.field("model").type) or table["model"].null_count:
        raise ResultError(f"{file}: column model holds no names; run again")
    return table


def read_states(file: Path, *, rows: int) -> pa.Table:
    """``tracks.parquet``: states that are numbers, and no larger than those of a recording."""
    columns = ("x", "y", "vx", "vy", "psi_rad")
    table = read_table(file, columns=("case_id", "track_id", *columns), rows=rows)
    for name in columns:
        numbers = pa.types.is_floating(table.schema.field(name).type)
        if not numbers or not (np.abs(np.asarray(table[name])) <= LARGEST_STATE).all():
            raise ResultError(f"{file}: column {name} holds what no run writes; run again")
    return table


def with_own_collisions(table: pa.Table, collisions: pa.Table, vehicles: Iterable[str]) -> pa.Table:
    """Metrics of the pairs that involve some vehicles, and whether one of these collides."""
    own = [int(track) for track in vehicles]
    either = [np.isin(np.asarray(collisions[name]), own) for name in ("track_id", "other_id")]
    struck = np.asarray(collisions["child"])[either[0] | either[1]]
    hit = np.isin(np.asarray(table["child"]), struck).astype(np.float64)
    return table.add_column(1, COLLISION, pa.array(hit))


def states_of(rows: pa.Table, vehicles: int, frames: int) -> States:
    """(V, T) states of one child, from its rows of ``tracks.parquet``."""
    x, y, vx, vy, psi = (
        np.asarray(rows[name]).reshape(vehicles, frames) for name in ("x", "y", "vx", "vy", "psi_rad")
    )
    return States(x=x, y=y, heading=psi, speed=np.hypot(vx, vy))


def kept_scene(folder: Path, known: Mapping[str, Any]) -> SeedScene:
    """The seed scene that ``seed.csv`` holds, vehicles as ``run.json`` names them."""
    from scex_sumo.converters.datasets.seed import recorded_scene

    scene = recorded_scene(folder / known["name"], tracks=folder / "seed.csv", case="1.0", repair=False)
    where = {int(track): index for index, track in enumerate(scene.track_ids)}
    if sorted(where) != sorted(known["track_ids"]):
        raise ResultError(f"{folder}: seed.csv is not that of run.json; run again")
    return scene.reordered([where[track] for track in known["track_ids"]], name=known["name"])


def as_pandas(table: pa.Table) -> Any:
    """A pandas data frame; a plain message where pandas is not installed."""
    if importlib.util.find_spec("pandas") is None:
        raise UsageError("to_pandas needs pandas: pip install 'scex-sumo[notebook]'")
    return table.to_pandas()
