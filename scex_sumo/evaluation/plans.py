"""Plans of a result folder, read to evaluate gap times again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ResultError
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.results.tables.plans import PLANS
from scex_sumo.results.tables.reading import read_table


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredPlans:
    """Plans of a result folder.

    Attributes:
        path: the file, for messages.
        futures: (C,) numbers, ascending.
        track_ids: (V,).
        made_at: (R,) steps from the seed scene, ascending.
        x: (C, V, R, H) m; column 0 is one step after the plan.
    """

    path: Path
    futures: IntArray
    track_ids: IntArray
    made_at: IntArray
    x: FloatArray
    y: FloatArray

    def paths(
        self, cases: NDArray[np.str_], track_ids: IntArray, there: BoolArray, steps: int
    ) -> PlannedPaths:
        """Return the planned paths of futures ``cases`` (C,) and vehicles (C, V) in any order.

        ``there`` (C, V) is False where a future has fewer vehicles.

        Raises:
            ResultError: a vehicle has no plan.
        """
        future, known_future = _find(self.futures.astype(str), cases)
        vehicle, known_vehicle = _find(self.track_ids, track_ids)
        missing = there & ~(known_future[:, None] & known_vehicle)
        if missing.any():
            c, v = (int(i) for i in np.argwhere(missing)[0])
            raise ResultError(
                f"{self.path}: no plan of vehicle {track_ids[c, v]} in future {cases[c]}, "
                "which tracks.parquet has; run again"
            )

        def chosen(values: FloatArray) -> FloatArray:
            taken = values[future[:, None], vehicle]
            taken[~there] = np.nan
            return taken.transpose(0, 2, 1, 3)

        return PlannedPaths.from_replans(chosen(self.x), chosen(self.y), self.made_at, steps)


def _find(known: NDArray[Any], wanted: NDArray[Any]) -> tuple[IntArray, BoolArray]:
    """Return the index of each wanted value among the known ones, and whether it is there."""
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    return place, known[place] == wanted


def read_plans(folder: Path) -> StoredPlans | None:
    """Read the plans of a result folder; None if it has none.

    Raises:
        ResultError: the file is unreadable or not one of ``scex-sumo run``.
    """
    path = folder / PLANS
    if not path.is_file():
        return None
    names, axes = ("future", "track_id", "step"), ("x", "y")
    table = read_table(path, columns=(*names, *axes))
    future, track_id, step = (np.asarray(table[name]) for name in names)
    lists = [table[name].combine_chunks() for name in axes]
    futures, made_at = np.unique(future), np.unique(step)
    rounds = max(len(made_at), 1)
    track_ids = track_id[: len(future) // max(len(futures), 1) : rounds]
    grid = (len(futures), len(track_ids), rounds)
    whole = (
        len(future) > 0
        and all(values.dtype == np.int64 for values in (future, track_id, step))
        and len(future) == np.prod(grid)
        and np.array_equal(future, np.repeat(futures, grid[1] * rounds))
        and np.array_equal(track_id, np.tile(np.repeat(track_ids, rounds), grid[0]))
        and np.array_equal(step, np.tile(made_at, grid[0] * grid[1]))
        and all(pa.types.is_fixed_size_list(column.type) for column in lists)
    )
    if not whole:
        raise ResultError(f"{path}: plans of some vehicles or futures are missing; run again")
    x, y = (np.asarray(column.flatten(), dtype=np.float64).reshape(*grid, -1) for column in lists)
    return StoredPlans(path=path, futures=futures, track_ids=track_ids, made_at=made_at, x=x, y=y)
