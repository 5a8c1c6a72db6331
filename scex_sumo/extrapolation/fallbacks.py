"""Fallbacks of a run: plans of the path-following driver in the place of unusable ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.extrapolation.rollout import Replaced
from scex_sumo.scene import STEP_S

FALLBACKS: Final = "fallbacks.parquet"


def fallbacks_table(
    replaced: Sequence[Replaced],
    *,
    children: IntArray,
    assignment: IntArray,
    names: Sequence[str],
    track_ids: IntArray,
) -> pa.Table | None:
    """Return the rows of ``fallbacks.parquet``, by child, step, vehicle; None for none.

    Args:
        children: (C,) numbers, ascending.
        assignment: (C, V) index into `names`.
    """
    if not replaced:
        return None
    rows = sorted(replaced, key=lambda r: (r.child, r.step, r.vehicle))
    child = np.array([r.child for r in rows], dtype=np.int64)
    vehicle = np.array([r.vehicle for r in rows], dtype=np.int64)
    model = assignment[np.searchsorted(children, child), vehicle]
    return pa.table(
        {
            "child": child,
            "track_id": np.asarray(track_ids, dtype=np.int64)[vehicle],
            "step": np.array([r.step for r in rows], dtype=np.int64),
            "model": pa.array([names[m] for m in model.tolist()], pa.string()),
            "reason": pa.array([r.reason for r in rows], pa.string()),
        }
    )


def count_fallbacks(
    table: pa.Table | None, assignment: IntArray, names: Sequence[str], rounds: int
) -> list[dict[str, Any]]:
    """Count the replaced plans of each model that has any, for ``run.json``.

    Args:
        assignment: (C, V) index into `names`.
        rounds: plans of a vehicle in a child.
    """
    if table is None:
        return []
    models = np.asarray(table["model"].to_pylist())
    counts = []
    for index, name in enumerate(names):
        mine = table.filter(pa.array(models == name))
        if mine.num_rows:
            counts.append(
                {
                    "model": name,
                    "replaced": mine.num_rows,
                    "plans": int((assignment == index).sum()) * rounds,
                    "children": len(set(mine["child"].to_pylist())),
                    "first": mine.drop_columns(["model"]).slice(0, 1).to_pylist()[0],
                }
            )
    return counts


def fallback_lines(counts: Sequence[dict[str, Any]]) -> list[str]:
    """Return the counts as text, a line for each model."""
    return [
        f"{c['model']}: {c['replaced']} of {c['plans']} plans replaced by the path-following driver's, "
        f"in {c['children']} {'future' if c['children'] == 1 else 'futures'}; "
        f"first (future {c['first']['child']}, vehicle {c['first']['track_id']}, "
        f"{c['first']['step'] * STEP_S:.1f} s): {c['first']['reason']}"
        for c in counts
    ]
