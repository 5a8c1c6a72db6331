"""Tables of a result folder as a page shows them: encounters, collisions, worst events, the likely children."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import side_of
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.statistics.density import wilson

REFERENCE = "reference"
COLLISION = -1
"""Number of collisions among the metrics of a page."""


def optional_table(run: Run, name: str) -> pa.Table | None:
    """One of the folder's Parquet files, or None where the run has not written it."""
    return run.table(name) if (run.folder / name).is_file() else None


def event_rows(run: Run, track_ids: Sequence[int]) -> list[dict[str, Any]]:
    """Where children are worst, by metric the worst first; children with the same event are one row.

    Returns:
        ``metric`` as its index or -1 for collisions, ``vehicles`` by index, ``step`` after the moment,
        ``value``, and ``children``.
    """
    groups: dict[tuple[Any, ...], list[int]] = {}
    where = {int(track): index for index, track in enumerate(track_ids)}
    number = {name: index for index, name in enumerate(run.columns)}

    def add(metric: int, row: Mapping[str, Any], step: int, value: float) -> None:
        vehicles = tuple(where[v] for v in (row["track_id"], row["other_id"]) if v in where)
        groups.setdefault((metric, vehicles, step, float(f"{value:.3g}")), []).append(row["child"])

    for row in _rows(optional_table(run, "worst.parquet")):
        if row["metric"] in number:
            step = row["timestamp_ms"] // 100 - LOGGED_HISTORY
            add(number[row["metric"]], row, step, row["value"])
    for row in _rows(optional_table(run, "collisions.parquet")):
        add(COLLISION, row, row["step"], 0.0)
    rows = [
        {"metric": metric, "vehicles": vehicles, "step": step, "value": value, "children": children}
        for (metric, vehicles, step, value), children in groups.items()
    ]
    signs = [1 if side_of(name) == "left" else -1 for name in run.columns] + [1]  # -1 is the last one
    return sorted(rows, key=lambda r: (r["metric"], signs[r["metric"]] * r["value"], r["step"]))


def collision_arrays(run: Run) -> dict[str, NDArray[Any]]:
    """Collisions: ``collision_children`` (n,) and ``collision_places`` (n, 2) in m; none where unknown."""
    table = optional_table(run, "collisions.parquet")
    if table is None:
        return {}
    places = np.stack([np.asarray(table["x"]), np.asarray(table["y"])], axis=1)
    return {"collision_children": np.asarray(table["child"]), "collision_places": places}


def collision_share(run: Run) -> dict[str, Any] | None:
    """How many children collide, and their share with its 95 % interval; None where that is not known."""
    table = optional_table(run, "collisions.parquet")
    if table is None:
        return None
    count = len(table["child"].unique())
    share = wilson(count, run.children)
    return {"count": count, "value": share.value, "low": share.low, "high": share.high}


def encounter_rows(run: Run, track_ids: Sequence[int]) -> list[dict[str, Any]]:
    """Rows of ``encounters.parquet`` with short numbers, ``pair`` by index, ``step`` and a sentence.

    None where the run has none.
    """
    where = {int(track): index for index, track in enumerate(track_ids)}
    rows = []
    for row in _rows(optional_table(run, "encounters.parquet")):
        short = {name: _short(value) for name, value in row.items() if name != "models"}
        short["pair"] = [where[row["track_id"]], where[row["other_id"]]]
        short["step"] = round(row["time_s"] / STEP_S)
        rows.append(short)
    return rows


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


def _rows(table: pa.Table | None) -> list[dict[str, Any]]:
    return [] if table is None else table.to_pylist()


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return None if not np.isfinite(value) else float(f"{value:.5g}")
    return value
