"""Type checkers and editors know the options of `extrapolate`, both kinds of drivers, and a run's tables."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import scex_sumo
from scex_sumo.extrapolation.options import RUN_OPTIONS
from scex_sumo.steps.extrapolate import RunKeywords

OURS = {"bar", "command", "is_reference"}  # of this package's own callers
PACKAGE = Path(scex_sumo.__file__).parent
USED = (
    "__init__.pyi", "steps/extrapolate.py", "behaviors/base.py", "scene.py", "road.py",
    "results/run.py", "base/arrow.pyi", "base/arguments.py", "scenarios/seeds.py",
)  # fmt: skip
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
run.metrics.num_rows + run.table("worst.parquet").rows
"""


def test_the_keywords_are_the_options_of_a_run_with_their_types() -> None:
    options = {one.name: one.type for kind in RUN_OPTIONS for one in dataclasses.fields(kind) if one.init}
    named = {name: kind.__forward_arg__ for name, kind in RunKeywords.__annotations__.items()}
    assert named == {name: kind for name, kind in options.items() if name not in OURS}


def test_mypy_accepts_a_driver_for_one_vehicle_and_refuses_unknown_options_and_names(tmp_path: Path) -> None:
    """It knows the tables too, although pyarrow ships no types."""
    mypy = pytest.importorskip("mypy.api")
    (tmp_path / "mine.py").write_text(DRIVERS)
    # Without the modules that these import, which takes a second or two instead of a minute.
    words = "--no-error-summary", "--hide-error-context", "--follow-imports=skip", f"--cache-dir={tmp_path}"
    said, _, _ = mypy.run([str(tmp_path / "mine.py"), *(str(PACKAGE / file) for file in USED), *words])
    errors = [
        line.partition("mine.py:")[2]
        for line in said.splitlines()
        if "mine.py" in line and ": error: " in line
    ]
    first = DRIVERS.splitlines().index("lost: scex.Behavior = Lost()") + 1
    assert [int(error.split(":")[0]) for error in errors] == [first, first + 1, first + 2, first + 3], said
    assert 'Unexpected keyword argument "futurs"' in errors[1]
    assert '"ArrowTable" has no attribute "rows"' in errors[3]
