"""Both answers of a run: what is possible, and beside it what is likely."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from rich.console import Console

from scex_sumo.reports.run_table import print_summary, summary_table
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.steps.reference import REFERENCE_FUTURES, reference_futures
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
    terminal = Console(width=80, force_terminal=True, color_system=None, file=io.StringIO())
    print_summary(again, terminal)
    assert isinstance(terminal.file, io.StringIO)
    lines = terminal.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    told = " ".join(" ".join(lines).split())
    stress = f"stress test: a collision in {again.collision.percent} of futures, driven as any of the models"
    assert again.decision is not None and told.startswith(" ".join(again.decision.sentence.split()))
    assert 0 < told.index("human-like, a contact of two within 3 s:") < told.index(stress)
    assert extrapolate(scene, **options).reference is None


@pytest.mark.parametrize(
    ("futures", "steps", "expected"),
    [(2, 5, 117), (2, 30, 117), (385, 30, 117), (2, 60, 58), (385, 980, 117), (40, 980, 40), (2, 980, 3)],
)
def test_a_reference_costs_no_more_than_the_run_or_a_short_one(
    futures: int, steps: int, expected: int
) -> None:
    assert reference_futures(futures, steps) == expected
