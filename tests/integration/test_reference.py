"""Both answers of a run: what is possible, and beside it what is likely."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from scex_sumo.reports.run_table import summary_table
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.steps.moment import REFERENCE_FUTURES, reference_futures
from tests.runs import extrapolate


def test_a_reference_stands_beside_a_run_and_changes_nothing_of_it(tmp_path: Path) -> None:
    scene = read_seed(example_path("motorway_merge"))
    options = {"out": tmp_path, "models": "rules", "futures": 4, "steps": 5}
    run = extrapolate(scene, **options)
    before = (tmp_path / "tracks.parquet").read_bytes()
    likely = extrapolate(scene, reference="likely", **options).reference
    assert likely is not None
    assert (tmp_path / "tracks.parquet").read_bytes() == before
    assert likely.futures == REFERENCE_FUTURES
    assert json.loads((tmp_path / "reference" / "run.json").read_text())["models"]
    drivers = pq.read_table(tmp_path / "reference" / "assignments.parquet")["model"].to_pylist()
    assert set(drivers) == {"likely_driver"}
    again = type(run)(tmp_path)
    headers = [str(column.header) for column in summary_table(again).columns]
    assert "human-like" in headers and "stress test" in headers
    assert extrapolate(scene, **options).reference is None


@pytest.mark.parametrize(
    ("futures", "steps", "expected"),
    [(2, 5, 32), (2, 30, 16), (385, 30, 32), (2, 60, 8), (385, 980, 32), (20, 980, 20), (2, 980, 2)],
)
def test_a_reference_costs_no_more_than_the_run_or_a_short_one(
    futures: int, steps: int, expected: int
) -> None:
    assert reference_futures(futures, steps) == expected
