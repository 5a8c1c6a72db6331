"""Tables of a result folder that a page shows where they are: encounters, collisions, the likely children."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray
from scex_sumo.results.run import Run

REFERENCE = "reference"


def optional_table(run: Run, name: str) -> pa.Table | None:
    """One of the folder's Parquet files, or None where the run has not written it."""
    return run.table(name) if (run.folder / name).is_file() else None


def vehicle_index(values: Sequence[int | None], track_ids: Sequence[int]) -> NDArray[np.int64]:
    """(n,) positions of tracks in the seed scene; -1 for none and for others."""
    where = {int(track): index for index, track in enumerate(track_ids)}
    return np.array([-1 if v is None else where.get(int(v), -1) for v in values], dtype=np.int64)


def event_arrays(run: Run, track_ids: Sequence[int], metrics: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Where each extremum came from.

    Returns:
        ``event_rows`` (n, 5): child, metric, step after the moment, vehicle, other vehicle or -1.
    """
    table = optional_table(run, "worst.parquet")
    if table is None:
        return {"event_rows": np.zeros((0, 5), dtype=np.int64)}
    coded = table["metric"].combine_chunks().dictionary_encode()
    known = np.array([metrics.index(n) if n in metrics else -1 for n in coded.dictionary.to_pylist()], int)
    rows = np.stack(
        [
            np.asarray(table["child"]),
            known[np.asarray(coded.indices)],
            np.asarray(table["timestamp_ms"]) // 100 - 10,
            vehicle_index(table["track_id"].to_pylist(), track_ids),
            vehicle_index(table["other_id"].to_pylist(), track_ids),
        ],
        axis=1,
    )
    return {"event_rows": rows.astype(np.int64)}


def collision_arrays(run: Run, track_ids: Sequence[int]) -> dict[str, NDArray[Any]]:
    """First contacts: ``collision_rows`` (n, 4) child, step, vehicle, other, and ``collision_places`` (n, 2).

    Nothing where the run has no ``collisions.parquet``: then the page looks for bodies that overlap itself.
    """
    table = optional_table(run, "collisions.parquet")
    if table is None:
        return {}
    rows = [
        np.asarray(table["child"]),
        np.asarray(table["step"]),
        vehicle_index(table["track_id"].to_pylist(), track_ids),
        vehicle_index(table["other_id"].to_pylist(), track_ids),
    ]
    found: dict[str, NDArray[Any]] = {"collision_rows": np.stack(rows, axis=1).astype(np.int64)}
    if {"x", "y"} <= set(table.column_names):
        found["collision_places"] = np.stack([np.asarray(table["x"]), np.asarray(table["y"])], axis=1)
    return found


def encounter_rows(run: Run) -> list[dict[str, Any]] | None:
    """Rows of ``encounters.parquet`` with short numbers; None where the run has none."""
    table = optional_table(run, "encounters.parquet")
    if table is None:
        return None
    return [{name: _short(value) for name, value in row.items()} for row in table.to_pylist()]


def likely_values(run: Run, columns: Sequence[str]) -> FloatArray | None:
    """(C, M) values of the likely children, NaN where undefined; None where they were not run."""
    if not (run.folder / REFERENCE / "run.json").is_file():
        return None
    return metric_values(Run(run.folder / REFERENCE).metrics, columns)


def likely_collisions(run: Run) -> tuple[int, int] | None:
    """How many of the likely children collide, and of how many; None where that is not known."""
    if not (run.folder / REFERENCE / "collisions.parquet").is_file():
        return None
    likely = Run(run.folder / REFERENCE)
    return len(likely.table("collisions.parquet")["child"].unique()), likely.children


def metric_values(table: pa.Table, columns: Sequence[str]) -> FloatArray:
    """(C, M) columns of a table of metrics; NaN where undefined or not there."""
    missing = np.full(table.num_rows, np.nan)
    parts = [
        table[name].to_numpy(zero_copy_only=False) if name in table.column_names else missing
        for name in columns
    ]
    return np.stack([np.asarray(part, dtype=np.float64) for part in parts], axis=1)


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return None if not np.isfinite(value) else float(f"{value:.5g}")
    return {k: _short(v) for k, v in value.items()} if isinstance(value, Mapping) else value
