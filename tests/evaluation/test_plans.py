"""Plans come back from the result folder as they were made, for whom and when they were made."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.evaluation.plans import read_plans
from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.plans import plans_table
from scex_sumo.scene import States
from tests.seeds import straight_seed

SEED = dataclasses.replace(straight_seed(), track_ids=np.array([20, 3]))


def plans_of(futures: list[int]) -> Part:
    """Two plans of four steps per vehicle; x tells future, replan, vehicle and step by its digits."""
    c, r, v, h = np.meshgrid(futures, [0, 1], [0, 1], range(4), indexing="ij")
    x = 1000.0 * c + 100 * r + 10 * v + h
    count = len(futures)
    return Part(
        futures=np.asarray(futures),
        states=States.empty((count, 10, 2)),
        values=np.zeros((count, 12)),
        defined=np.ones((count, 12), dtype=bool),
        worst=pa.table({}),
        plan_x=x,
        plan_y=-x,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A result folder with the plans of futures 0, 1 and 10, remade every five steps."""
    table = plans_table(SEED, plans_of([0, 1, 10]), replan=5)
    ResultFolder(tmp_path / "out", {}).write_table("plans.parquet", table)
    return tmp_path / "out"


def test_rows_are_ordered_by_future_vehicle_and_step(folder: Path) -> None:
    rows = pq.read_table(folder / "plans.parquet").to_pylist()
    keys = [(row["future"], row["track_id"], row["step"]) for row in rows]
    assert keys == [(future, track, step) for future in (0, 1, 10) for track in (20, 3) for step in (0, 5)]
    assert rows[7] == {
        "future": 1,
        "track_id": 3,
        "step": 5,
        "x": [1110.0, 1111.0, 1112.0, 1113.0],
        "y": [-1110.0, -1111.0, -1112.0, -1113.0],
    }


def test_a_damaged_file_is_said(folder: Path) -> None:
    file = folder / "plans.parquet"
    table = pq.read_table(file)
    huge = table.set_column(2, "step", pa.array([1e308] * 12))
    for wrong in (table.slice(1), table.slice(0, 0), table.take(list(range(12))[::-1]), huge):
        pq.write_table(wrong, file)
        with pytest.raises(ResultError, match="plans of some vehicles or futures are missing; run again"):
            read_plans(folder)
    pq.write_table(table.drop_columns(["y"]), file)
    with pytest.raises(ResultError, match=r"plans\.parquet: column y is missing"):
        read_plans(folder)
    file.write_text("no parquet")
    with pytest.raises(ResultError, match=r"plans\.parquet: cannot be read"):
        read_plans(folder)
