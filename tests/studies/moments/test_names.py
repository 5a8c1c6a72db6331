"""Which seeds a recording is cut into, and what they are called."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.datasets.moment import Moment
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.moments.folder import moment_name
from scex_sumo.studies.moments.study import list_moments

RECORDING = Recording(
    name="k733_000", site="k733", dataset="taf_bw", map_path=Path("k733.osm"), track_paths=(Path("t.csv"),)
)


@pytest.mark.parametrize(
    ("case", "time_s", "name"),
    [
        ("", 60.0, "r_t60.0"),
        ("", 60.04, "r_t60.040"),
        ("12.0", 1.0, "r_case12.0_t1.0"),
        ("a/b c", 1.0, "r_casea-b-c_t1.0"),
    ],
)
def test_names_tell_recording_case_and_time(case: str, time_s: float, name: str) -> None:
    assert moment_name("r", case, time_s) == name


def test_moments_need_vehicles_that_move_and_cases_vehicles() -> None:
    moments = [
        Moment(case="", time_s=1.0, vehicles=9, complete=1),
        Moment(case="", time_s=2.0, vehicles=9, complete=2),
        Moment(case="7", time_s=1.0, vehicles=2, complete=0),
        Moment(case="8", time_s=1.0, vehicles=1, complete=1),
    ]
    listing = list_moments(RECORDING, moments)
    assert [ref.moment for ref in listing] == ["k733_000_t2.0", "k733_000_case7_t1.0"]
    assert [ref.vehicles for ref in listing] == [9, 2]
    assert {ref.location for ref in listing} == {"k733"}
