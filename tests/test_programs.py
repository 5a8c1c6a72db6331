"""SUMO's programs are those of the wheel, whatever the user has installed."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.errors import SimulationError
from scex_sumo.programs import environment, program, sumo_home


def test_programs_are_the_wheels(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SUMO_HOME", "/elsewhere")
    assert Path(program("sumo")).is_relative_to(sumo_home())
    assert environment()["SUMO_HOME"] == str(sumo_home())


def test_a_program_that_the_wheel_does_not_have_is_named():
    with pytest.raises(SimulationError, match="SUMO's program sumoo is missing; reinstall eclipse-sumo"):
        program("sumoo")
