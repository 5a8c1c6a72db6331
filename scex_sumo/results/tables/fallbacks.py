"""Plans that a fallback planner made in the place of a model's: ``fallbacks.parquet``, counts and words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.scene import STEP_S


def fallbacks_table(
    replaced: Sequence[tuple[int, int, int, str]],
    *,
    futures: IntArray,
    assignment: IntArray,
    names: Sequence[str],
    track_ids: IntArray,
) -> pa.Table:
    """Return the rows of ``fallbacks.parquet``, by future, step, vehicle.

    Args:
        replaced: number of the future, step, index of the vehicle, reason.
        futures: (C,) numbers, ascending.
        assignment: (C, V) index into `names`.
    """
    future, step, vehicle, reason = zip(*sorted(replaced), strict=True)
    model = assignment[np.searchsorted(futures, future), list(vehicle)]
    return pa.table(
        {
            "future": pa.array(future, pa.int64()),
            "track_id": np.asarray(track_ids, dtype=np.int64)[list(vehicle)],
            "step": pa.array(step, pa.int64()),
            "model": pa.array([names[m] for m in model.tolist()], pa.string()),
            "reason": pa.array(reason, pa.string()),
        }
    )


def count_fallbacks(
    table: pa.Table, assignment: IntArray, names: Sequence[str], rounds: int
) -> list[dict[str, Any]]:
    """Count the replaced plans of each model that has any, for ``run.json``.

    Args:
        assignment: (C, V) index into `names`.
        rounds: plans of a vehicle in a future.
    """
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
                    "futures": len(set(mine["future"].to_pylist())),
                    "first": mine.drop_columns(["model"]).slice(0, 1).to_pylist()[0],
                }
            )
    return counts


def fallback_lines(counts: Sequence[dict[str, Any]]) -> list[str]:
    """Return the counts as text, a line for each model."""
    return [
        f"{c['model']}: {c['replaced']} of {c['plans']} plans replaced by the path-following driver's, "
        f"in {c['futures']} {'future' if c['futures'] == 1 else 'futures'}; "
        f"first (future {c['first']['future']}, vehicle {c['first']['track_id']}, "
        f"{c['first']['step'] * STEP_S:.1f} s): {c['first']['reason']}"
        for c in counts
    ]
