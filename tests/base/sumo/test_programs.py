"""SUMO's programs are those of the wheel, whatever the user has installed."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo as scex
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.sumo.programs import environment, program, sumo_home
from tests.runs import extrapolate


def test_programs_are_the_wheels(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SUMO_HOME", "/elsewhere")
    assert Path(program("sumo")).is_relative_to(sumo_home())
    assert environment()["SUMO_HOME"] == str(sumo_home())


def test_a_program_that_the_wheel_does_not_have_is_named():
    with pytest.raises(SimulationError, match="SUMO's program sumoo is missing; reinstall eclipse-sumo"):
        program("sumoo")


def test_a_comma_in_the_temporary_folder_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a,b"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    seed = scex.read_seed(scex.example_path("roundabout"))
    with pytest.raises(SimulationError, match=r"SUMO splits paths at commas; set TMPDIR"):
        extrapolate(seed, futures=1, models=["sumo:EIDM"], out=tmp_path / "out")


def test_a_comma_in_the_result_folder_does_no_harm(tmp_path: Path) -> None:
    seed = scex.read_seed(scex.example_path("roundabout"))
    run = extrapolate(seed, futures=1, models=["sumo:EIDM"], out=tmp_path / "a,b")
    assert run.info["futures"] == 1
