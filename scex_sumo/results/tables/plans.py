"""Stored plans of all vehicles of all futures, ``plans.parquet``."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray
from scex_sumo.results.parts import Part
from scex_sumo.scene import SeedScene

PLANS = "plans.parquet"


def plans_table(scene: SeedScene, part: Part, replan: int) -> pa.Table:
    """Tabulate the plans of a part that has them, by future, vehicle, step.

    Returns:
        future, track_id, step of the plan from the seed scene; x and y: lists of H centres in m, the first
        a step later.
    """
    assert part.plan_x is not None and part.plan_y is not None
    count, rounds, vehicles, length = part.plan_x.shape

    def column(values: FloatArray) -> pa.Array:
        return pa.FixedSizeListArray.from_arrays(
            pa.array(values.transpose(0, 2, 1, 3).reshape(-1), pa.float64()), length
        )

    return pa.table(
        {
            "future": np.repeat(part.futures, vehicles * rounds),
            "track_id": np.tile(np.repeat(np.asarray(scene.track_ids), rounds), count),
            "step": np.tile(np.arange(rounds, dtype=np.int64) * replan, count * vehicles),
            "x": column(part.plan_x),
            "y": column(part.plan_y),
        }
    )
