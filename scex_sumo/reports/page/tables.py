"""Tables of a report: encounters, collisions, worst events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray
from scex_sumo.evaluation.outcomes import COLLISIONS
from scex_sumo.metrics.registry import COLLISION as COLLISION_COLUMN
from scex_sumo.reports.encounter_rows import HUMAN_LIKE, STRESS_TEST, Meeting, meetings, worst_of
from scex_sumo.reports.encounter_table import QUESTIONS
from scex_sumo.reports.run_table import expected_injuries
from scex_sumo.results.exact import Encounter
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S

_WORST = 3
_SETS = "Stress test, or human-like where the pair is critical in these"
_NAMED = 4  # children of an event whose numbers are shown
_COLLISION = -1  # number of collisions among the metrics of a page


def event_table(run: Run, track_ids: Sequence[int], sides: Sequence[str]) -> dict[str, Any]:
    """Return the worst events by metric, the worst first; children with the same event share a row.

    Returns:
        Rows have the index of the ``metric`` (-1: collision), ``children``, the first ``child``, ``step``
        after the seed moment, and ``pair`` by index or None.
    """
    groups: dict[tuple[int, tuple[int, ...], int, float], list[int]] = {}
    where = {int(track): index for index, track in enumerate(track_ids)}
    number = {name: index for index, name in enumerate(run.columns)}

    def add(metric: int, row: Mapping[str, Any], step: int, value: float) -> None:
        vehicles = tuple(where[v] for v in (row["track_id"], row["other_id"]) if v in where)
        groups.setdefault((metric, vehicles, step, float(f"{value:.3g}")), []).append(row["child"])

    for row in _rows(run, "worst.parquet"):
        if row["metric"] in number:
            step = row["timestamp_ms"] // 100 - LOGGED_HISTORY
            if np.isfinite(row["value"]) or sides[number[row["metric"]]] == "right":
                add(number[row["metric"]], row, step, row["value"])
    for row in _rows(run, COLLISIONS):
        add(_COLLISION, row, row["step"], row["relative_speed"])
    signs = [1 if side == "left" else -1 for side in sides] + [-1]  # the last sign: collisions
    order = sorted(groups.items(), key=lambda item: (item[0][0], signs[item[0][0]] * item[0][3], item[0][2]))
    columns = [
        {"title": "vehicles"},
        {"title": "value", "as": "real", "none": "∞"},
        {"title": "after", "as": "seconds"},
        {"title": "futures", "as": "times", "down": True},
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


def collision_places(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Return ``children``, ``places`` (m) and ``pairs`` by index of collisions."""
    rows, where = _rows(run, COLLISIONS), {int(track): index for index, track in enumerate(track_ids)}
    pairs = [(where[row["track_id"]], where[row["other_id"]]) for row in rows]
    places = [(round(row["x"], 2), round(row["y"], 2)) for row in rows]
    return {"children": [row["child"] for row in rows], "places": places, "pairs": pairs}


def collision_share(run: Run) -> dict[str, Any] | None:
    """Return number, share and 95 % interval of children with a collision; None if unknown."""
    if COLLISION_COLUMN not in run.metrics.column_names:
        return None
    share, count = run.p_collision, int(np.asarray(run.metrics[COLLISION_COLUMN]).sum())
    interval = {"value": share.value, "low": share.low, "high": share.high, "exact": share.exact}
    rare = share.rare and {"short": share.rare.short, "words": share.rare.words()}
    known = {"count": count, "children": run.children, "injuries": expected_injuries(run), "rare": rare}
    return {**known, **interval}


def encounter_table(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Return the encounters of both sets with ``words``, ``pair`` by index, ``child``, ``step``, ``worst``.

    ``selected`` tells what a column shows of selected futures: of a pair only collisions are known by future.
    The child of a human-like row is -1, because the page holds the futures of the stress test alone.
    """
    found, where = meetings(run), {int(track): index for index, track in enumerate(track_ids)}
    of = "Share of the futures; a click on a row shows the typical one. A dash: not known of selected futures"
    columns = [
        {"title": "pair"},
        {"title": "futures", "hint": f"{_SETS}: a click shows all futures of the stress test"},
        {"title": "P(collision)", "as": "percent", "down": True, "hint": of, "selected": "share"},
        {"title": "95 %", "selected": "range"},
        *(
            {"title": f"P({q.upper()})", "as": "percent", "down": True, "hint": f"{QUESTIONS[q]}. {of}"}
            | {"selected": "unknown"}
            for q in ("ttc", "pet", "drac")
        ),
        {"title": "gap", "as": "metres", "hint": "Least gap in the typical future; up to 10 m"},
        {"title": "after", "as": "seconds"},
    ]
    rows = [
        {
            "cells": _cells(one),
            "words": one.words(),
            "share": row["collision"],
            "critical": row["critical"] > 0,
            "pair": [where[row["track_id"]], where[row["other_id"]]],
            "child": row["child"] if one.futures == STRESS_TEST else -1,
            "step": round(row["time_s"] / STEP_S),
        }
        for one in found
        for row in [one.row]
    ]
    worst = worst_of(found, _WORST)
    for one, row in zip(found, rows, strict=True):
        row["worst"] = one in worst
    if not any(row["cells"][1] == HUMAN_LIKE for row in rows):
        columns.pop(1)
        for row in rows:
            row["cells"].pop(1)
    return {"columns": columns, "rows": rows}


def _cells(one: Meeting) -> list[Any]:
    """Return the cells of a row; probabilities are exact where there is a table."""
    row, found = one.row, Encounter(row=one.row, run=one.run)
    interval = f"{100 * row['collision_low']:.0f} – {100 * row['collision_high']:.0f} %"
    return [
        f"{row['track_id']} → {row['other_id']}",
        one.futures,
        _short(found.probability()),
        interval if found.table is None else "exact",
        *(_short(found.probability(name)) for name in ("ttc", "pet", "drac")),
        _short(row["gap"]),
        round(row["time_s"], 1),
    ]


def metric_values(table: pa.Table, columns: Sequence[str]) -> FloatArray:
    """Return (M, C) columns of a table, NaN where undefined or missing."""
    missing = np.full(table.num_rows, np.nan)
    parts = [
        table[name].to_numpy(zero_copy_only=False) if name in table.column_names else missing
        for name in columns
    ]
    return np.stack([np.asarray(part, dtype=np.float64) for part in parts])


def _rows(run: Run, name: str) -> list[dict[str, Any]]:
    return list(run.table(name).to_pylist()) if (run.folder / name).is_file() else []


def _short(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.5g}")
