"""SUMO's programs are those of the wheel, whatever the user has installed."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo as scex
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.sumo.programs import program, run_program
from tests.runs import extrapolate


def test_a_program_that_the_wheel_does_not_have_is_named():
    with pytest.raises(SimulationError, match="SUMO's program sumoo is missing; reinstall eclipse-sumo"):
        program("sumoo")


SPIRAL = """<OpenDRIVE><header revMajor="1" revMinor="5"/><road id="1" length="12.26" junction="-1"><planView>
<geometry s="0" x="0" y="0" hdg="0" length="12.26"><spiral curvStart="0.06909484578763794"
 curvEnd="0.06909484578763787"/></geometry></planView><lanes><laneSection s="0"><right>
<lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
</right></laneSection></lanes></road></OpenDRIVE>"""


def test_a_program_is_stopped_where_it_takes_all_memory_or_too_long(tmp_path: Path) -> None:
    (tmp_path / "map.xodr").write_text(SPIRAL)  # netconvert adds points to it for ever
    options = ("--opendrive-files", "map.xodr", "--opendrive.curve-resolution", "0.5")
    assert run_program("netconvert", *options, folder=tmp_path, file_bytes=500) == (
        "Error: netconvert was stopped at 1.5 GiB of memory",
    )
    assert run_program("netconvert", *options, folder=tmp_path, file_bytes=0, limit_s=0.01) == (
        "Error: netconvert was stopped after 0 s",
    )


def test_a_comma_in_the_temporary_folder_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a,b"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    seed = scex.read_seed(scex.example_path("roundabout"))
    with pytest.raises(SimulationError, match=r"SUMO splits paths at commas; set TMPDIR"):
        extrapolate(seed, futures=1, models=["sumo:EIDM"], out=tmp_path / "out")
