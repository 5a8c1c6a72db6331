"""Tables of a result folder as a page shows them: encounters, collisions, worst events, likely children."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import FloatArray
from scex_sumo.evaluation.encounters import ENCOUNTERS, in_words
from scex_sumo.evaluation.outcomes import COLLISIONS
from scex_sumo.metrics.registry import COLLISION as COLLISION_COLUMN
from scex_sumo.reports.tables.encounters import QUESTIONS
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S

_NAMED = 4
COLLISION = -1
"""Number of collisions among the metrics of a page."""


def optional_table(run: Run, name: str) -> pa.Table | None:
    """One of the folder's Parquet files, or None where the run has not written it."""
    return run.table(name) if (run.folder / name).is_file() else None


def event_table(run: Run, track_ids: Sequence[int], sides: Sequence[str]) -> dict[str, Any]:
    """Where children are worst, by metric the worst first; children with the same event are one row.

    Args:
        run: a finished run.
        track_ids: of its vehicles.
        sides: on which each column is critical.

    Returns:
        A table whose rows have ``metric`` as its index or -1 for collisions, ``children`` and the first of
        them as ``child``, ``step`` after the moment, and ``pair`` by index or None.
    """
    groups: dict[tuple[int, tuple[int, ...], int, float], list[int]] = {}
    where = {int(track): index for index, track in enumerate(track_ids)}
    number = {name: index for index, name in enumerate(run.columns)}

    def add(metric: int, row: Mapping[str, Any], step: int, value: float) -> None:
        vehicles = tuple(where[v] for v in (row["track_id"], row["other_id"]) if v in where)
        groups.setdefault((metric, vehicles, step, float(f"{value:.3g}")), []).append(row["child"])

    for row in _rows(optional_table(run, "worst.parquet")):
        if row["metric"] in number:
            step = row["timestamp_ms"] // 100 - LOGGED_HISTORY
            if np.isfinite(row["value"]) or sides[number[row["metric"]]] == "right":
                add(number[row["metric"]], row, step, row["value"])
    for row in _rows(optional_table(run, COLLISIONS)):
        add(COLLISION, row, row["step"], row["relative_speed"])
    signs = [1 if side == "left" else -1 for side in sides] + [-1]  # the last one are collisions
    order = sorted(groups.items(), key=lambda item: (item[0][0], signs[item[0][0]] * item[0][3], item[0][2]))
    columns = [
        {"title": "vehicles"},
        {"title": "value", "as": "real", "none": "∞", "hint": "Of collisions: relative speed, m/s"},
        {"title": "after", "as": "seconds"},
        {"title": "children", "as": "times", "down": True},
        {"title": "which", "kind": "words"},
    ]
    return {"columns": columns, "rows": [_event(key, children, track_ids) for key, children in order]}


def _event(
    key: tuple[int, tuple[int, ...], int, float], children: list[int], track_ids: Sequence[int]
) -> dict[str, Any]:
    metric, vehicles, step, value = key
    which = ", ".join(str(child) for child in children[:_NAMED]) + (", …" if len(children) > _NAMED else "")
    names = " – ".join(str(track_ids[vehicle]) for vehicle in vehicles)
    return {
        "cells": [names, value, step * STEP_S, len(children), which],
        "metric": metric,
        "pair": vehicles if len(vehicles) == 2 else None,
        "child": children[0],
        "children": children,
        "step": step,
    }


def collision_places(run: Run) -> dict[str, Any]:
    """Collisions: ``children`` and ``places``, x and y in m; none where unknown."""
    rows = _rows(optional_table(run, COLLISIONS))
    places = [(round(row["x"], 2), round(row["y"], 2)) for row in rows]
    return {"children": [row["child"] for row in rows], "places": places}


def collision_share(run: Run) -> dict[str, Any] | None:
    """How many of the children collide, and their share with its 95 % interval; None if not known."""
    if COLLISION_COLUMN not in run.metrics.column_names:
        return None
    share = run.p_collision
    count = int(np.asarray(run.metrics[COLLISION_COLUMN]).sum())
    sure = {"value": share.value, "low": share.low, "high": share.high}
    return {"count": count, "children": run.children, **sure}


def encounter_table(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Rows of ``encounters.parquet`` with ``words``, the ``pair`` by index, a ``child`` and its ``step``."""
    where = {int(track): index for index, track in enumerate(track_ids)}
    of = "Share of the children; a click on a row shows one of them"
    columns = [
        {"title": "pair"},
        {"title": "P(collision)", "as": "percent", "down": True, "hint": of},
        {"title": "95 %"},
        *(
            {"title": f"P({q.upper()})", "as": "percent", "down": True, "hint": f"{QUESTIONS[q]}. {of}"}
            for q in ("ttc", "pet", "drac")
        ),
        {"title": "gap", "as": "metres", "hint": "Least gap in the nearest 5 % of the children; up to 10 m"},
        {"title": "after", "as": "seconds"},
    ]
    rows = [
        {
            "cells": [
                f"{row['track_id']} → {row['other_id']}",
                _short(row["collision"]),
                f"{100 * row['collision_low']:.0f} – {100 * row['collision_high']:.0f} %",
                *(_short(row[name]) for name in ("ttc", "pet", "drac", "gap_p05")),
                round(row["time_s"], 1),
            ],
            "words": in_words(row),
            "critical": row["critical"] > 0,
            "pair": [where[row["track_id"]], where[row["other_id"]]],
            "child": row["child"],
            "step": round(row["time_s"] / STEP_S),
        }
        for row in _rows(optional_table(run, ENCOUNTERS))
    ]
    return {"columns": columns, "rows": rows}


def metric_values(table: pa.Table, columns: Sequence[str]) -> FloatArray:
    """(M, C) columns of a table of metrics; NaN where undefined or not there."""
    missing = np.full(table.num_rows, np.nan)
    parts = [
        table[name].to_numpy(zero_copy_only=False) if name in table.column_names else missing
        for name in columns
    ]
    return np.stack([np.asarray(part, dtype=np.float64) for part in parts])


def _rows(table: pa.Table | None) -> list[dict[str, Any]]:
    return [] if table is None else table.to_pylist()


def _short(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.5g}")
