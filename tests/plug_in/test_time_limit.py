"""Time limits: slow code gets a line, code without end an error, native code ends its process."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from scex_sumo.base.errors import OutOfTimeError
from scex_sumo.extrapolation.processes.pool import in_other_process
from scex_sumo.plug_in import time_limit
from scex_sumo.scenarios import example_path
from tests.command import scex

NEW_PROCESSES = True


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_limit, "QUIET_S", 0.5)
    monkeypatch.setattr(time_limit, "RETURN_S", 0.25)
    monkeypatch.setattr(time_limit, "last_words", [])


def endless() -> None:
    while True:
        try:
            while True:
                time.sleep(0.001)
        except Exception:
            continue


def test_python_code_without_end_raises_and_the_code_after_it_goes_on(
    impatient: None, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):  # the line comes once
        with (
            pytest.raises(OutOfTimeError, match=r"^the driver a did not return within 1 s; look for"),
            time_limit.time_limit("the driver a", 1.0),
            time_limit.time_limit("within", 0.1),
        ):
            endless()
    time.sleep(0.6)
    assert capsys.readouterr().err == "waiting up to 1 s for the driver a\n"


def stuck(seconds: float = 60.0) -> None:
    time_limit.RETURN_S = 0.25
    with time_limit.time_limit("the driver d", 0.25):
        time.sleep(seconds)  # as native code: no error is raised in it


def test_a_worker_in_native_code_without_end_reports_and_ends() -> None:
    start = time.monotonic()
    with pytest.raises(OutOfTimeError, match=r"^the driver d did not return within 0.25 s"):
        in_other_process(stuck, where="here", died="it died")
    assert time.monotonic() - start < 30


DRIVER = """
import time

import scex_sumo.plug_in.time_limit as t
import scex_sumo.plug_in.fallback as f

t.QUIET_S, t.RETURN_S, f.MAX_CALL_S, f.MAX_VEHICLE_S = 0.5, 0.25, 1.0, 0.0


def stuck(history):
    time.sleep(60)


def loops(history):
    while True:
        pass
"""


@pytest.mark.parametrize("name", ["stuck", "loops"])
def test_a_driver_without_end_ends_a_run_with_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(DRIVER)
    options = ("--models", f"slow:{name}", "--futures", "2", "--workers", "1", "-o", "out")
    done = scex("run", str(example_path("motorway_merge")), *options, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"waiting up to 1 s for the driver slow:{name}",
        f"error: the driver slow:{name} did not return within 1 s; look for an endless loop in it",
    ]
