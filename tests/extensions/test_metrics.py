"""A metric of another package is one file: used by its name on recordings and in runs."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import scex_sumo
from tests.command import ALONE
from tests.extensions.package import install, scex

CODE = """
import dataclasses

import numpy as np
import scex_sumo


@scex_sumo.metric("speed_gap", critical="max", unit="m/s", threshold=5.0, label="difference of speeds")
def speed_gap(scenes):
    first, second = scenes.pairs
    return scenes.unordered(np.abs(scenes.speed[second] - scenes.speed[first]))
"""
TRACKS = """track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width
1,1,100,car,0,0,10,0,0,4.5,1.8
1,2,200,car,1,0,10,0,0,4.5,1.8
2,1,100,car,20,0,4,0,0,4.5,1.8
2,2,200,car,20.4,0,4,0,0,4.5,1.8
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    install(tmp_path, group="scex_sumo.metrics", name="speed_gap", target="stranger:speed_gap", code=CODE)
    return tmp_path


def test_a_metric_of_another_package_is_a_column_of_a_run(package: Path) -> None:
    """Its function is needed for the run alone: the result is read where the package is absent."""
    out = package / "out"
    seed = scex_sumo.example_path("roundabout")
    few = ("--futures", 4, *ALONE, "--no-report", "-o", out)
    done = scex(package, "run", seed, "--metrics", "paper,speed_gap", *few)
    assert done.returncode == 0, done.stderr
    table = pq.read_table(out / "metrics.parquet")
    assert table.column_names[-3:] == ["speed_gap", "speed_gap_mean", "collision"]
    assert all(value > 0 for value in table["speed_gap"].to_pylist())
    info = json.loads((out / "run.json").read_text())
    assert info["thresholds"]["speed_gap"] == 5.0
    assert scex_sumo.open_run(out).p_critical("speed_gap").count == 4


def test_a_metric_that_cannot_be_imported_is_one_line(tmp_path: Path) -> None:
    install(
        tmp_path, group="scex_sumo.metrics", name="broken", target="stranger:no", code="import nothing_here"
    )
    tracks = tmp_path / "tracks.csv"
    tracks.write_text(TRACKS)
    done = scex(tmp_path, "metrics", tracks, "--metrics", "broken")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: stranger:no: stranger imports nothing_here, which is not installed\n"
