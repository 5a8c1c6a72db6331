"""Type checkers and editors know the options of `extrapolate`, and both kinds of drivers."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from scex_sumo.extrapolation.options import RUN_OPTIONS
from scex_sumo.steps.extrapolate import RunKeywords

OURS = {"bar", "command", "is_reference"}  # of this package's own callers
ROOT = Path(__file__).resolve().parents[2]
DRIVERS = """
import numpy as np
import scex_sumo as scex


class Parked:
    def plan_one(
        self, history: scex.SceneHistory, road: scex.Road, future: int, vehicle: int, rng: np.random.Generator
    ) -> scex.States:
        now = history.now[future, vehicle]
        x, y, heading = (np.full(30, float(value)) for value in (now.x, now.y, now.heading))
        return scex.States(x=x, y=y, heading=heading, speed=np.zeros(30))


class Lost:
    def go(self) -> None: ...


scene = scex.read_seed(scex.example_path("roundabout"))
driver: scex.Behavior = Parked()
run = scex.extrapolate(scene, futures=4, models=[Parked, "standard_driver@2"], report=False, out="out")
lost: scex.Behavior = Lost()
scex.extrapolate(scene, futurs=4)
scex.extrapolate(scene, steps="30")
"""


def test_the_keywords_are_the_options_of_a_run_with_their_types() -> None:
    options = {one.name: one.type for kind in RUN_OPTIONS for one in dataclasses.fields(kind) if one.init}
    named = {name: kind.__forward_arg__ for name, kind in RunKeywords.__annotations__.items()}
    assert named == {name: kind for name, kind in options.items() if name not in OURS}


def test_mypy_accepts_a_driver_for_one_vehicle_and_refuses_unknown_options(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "mine.py").write_text(DRIVERS)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--hide-error-context", tmp_path / "mine.py"],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "500"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    errors = [line.partition("mine.py:")[2] for line in done.stdout.splitlines() if ": error: " in line]
    first = DRIVERS.splitlines().index("lost: scex.Behavior = Lost()") + 1
    assert [int(error.split(":")[0]) for error in errors] == [first, first + 1, first + 2], done.stdout
    assert 'Unexpected keyword argument "futurs"' in errors[1]
