"""A driving function of the user's own, from the folder that the command is run in."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.results.under_test import UnderTest
from tests import command
from tests.command import ALONE

ROUNDABOUT = scex_sumo.example_path("roundabout")
MODELS = "standard_driver,constant_velocity"
DRIVER = '''
import numpy as np

import scex_sumo as scex


class Straight:
    """Keeps speed and heading; in odd futures it gives up after a while, in all of them where told to."""

    def __init__(self, *, gives_up=False):
        self.gives_up = gives_up

    def plan_one(self, history, road, future, vehicle, rng):
        if self.gives_up or (history.step >= 15 and history.futures[future] % 2):
            raise RuntimeError("lost the lane")
        now = history.now[future, vehicle]
        way = float(now.speed) * 0.1 * np.arange(1, 31)
        return scex.States(
            x=now.x + way * np.cos(now.heading),
            y=now.y + way * np.sin(now.heading),
            heading=np.full(30, now.heading),
            speed=np.full(30, now.speed),
        )
'''


def scex(where: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    return command.scex(*arguments, cwd=where)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a driver and the result of a run with it under test."""
    where = tmp_path_factory.mktemp("plug_in")
    (where / "drivers").mkdir()
    (where / "drivers" / "__init__.py").write_text(DRIVER)
    options = ("--futures", 6, "--models", MODELS, "--assign", "3=drivers:Straight", *ALONE)
    done = scex(where, "run", ROUNDABOUT, *options, "-o", "out")
    assert done.returncode == 0, done.stderr
    (where / "printed.txt").write_text(done.stdout)
    return where


def test_a_run_tells_the_vehicle_under_test_apart(folder: Path) -> None:
    printed = (folder / "printed.txt").read_text()
    assert "under test, vehicle 3: drivers:Straight: 6 futures" in printed
    assert "worse : better" in printed
    assert "Under test, vehicle 3: drivers:Straight" in (folder / "out" / "report.html").read_text()
    # One vehicle, 6 futures of 6 plans; 3 of these futures lose the last 3.
    line = (
        "drivers:Straight: 9 of 36 plans replaced by the path-following driver's, in 3 futures; "
        "first (future 1, vehicle 3, 1.5 s): raised RuntimeError: lost the lane (__init__.py, line 15)"
    )
    assert line in " ".join(printed.split())
    info = json.loads((folder / "out" / "run.json").read_text())
    assert info["under_test"] == {"3": "drivers:Straight"}
    assert info["fallbacks"][0]["replaced"] == 9
    assert list(info["sources"]) == ["drivers:Straight"]
    assert pq.read_table(folder / "out" / "fallbacks.parquet").num_rows == 9


def test_the_baseline_are_the_same_futures_but_for_that_vehicle(folder: Path) -> None:
    run = scex_sumo.open_run(folder / "out")
    assert run.baseline is not None
    other = np.asarray(run.assignments["track_id"]) != 3
    mine, theirs = (np.asarray(r.assignments["model"].to_pylist()) for r in (run, run.baseline))
    assert np.array_equal(mine[other], theirs[other])
    assert set(mine[~other]) == {"drivers:Straight"} and set(theirs[~other]) == set(MODELS.split(","))


def test_values_under_test_are_those_of_the_vehicles_own_pairs(folder: Path) -> None:
    done = scex(folder, "metrics", "out", "--level", "pair", "-o", "pairs.parquet")
    assert done.returncode == 0, done.stderr
    pairs = pq.read_table(folder / "pairs.parquet")
    involved = pc.or_(pc.equal(pairs["track_id"], 3), pc.equal(pairs["other_id"], 3))
    own = pairs.filter(pc.and_(pc.equal(pairs["metric"], "wttc"), involved))
    smallest = own.group_by("case_id").aggregate([("value", "min")]).sort_by("case_id")
    tested = UnderTest.of(scex_sumo.open_run(folder / "out")).metrics
    assert tested["wttc"].to_pylist() == smallest["value_min"].to_pylist()


def test_a_driver_that_fails_from_the_start_is_one_line_and_no_folder(folder: Path) -> None:
    options = ("--futures", 4, "--under-test", "3=drivers:Straight:gives_up=true", "-o", "none")
    done = scex(folder, "run", ROUNDABOUT, *options)
    assert done.returncode == 1
    (line,) = [text for text in done.stderr.splitlines() if not text.startswith("note: ")]
    assert line.startswith(
        "error: drivers:Straight:gives_up=true: no usable plan for any of 1 vehicles of the seed scene: "
        "raised RuntimeError: lost the lane (__init__.py, line 15); it is class Straight of"
    )
    assert not (folder / "none").exists()
