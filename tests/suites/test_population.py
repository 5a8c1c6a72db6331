"""Candidates of an encounter: each of the two that may be hit, with the other's action."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.rank.encounters import ENCOUNTERS
from scex_sumo.suites.population import candidates_of, read_population, recorded_hours

ROW = dict.fromkeys(ENCOUNTERS.names) | {
    "track_id": 1,
    "other_id": 2,
    "probability": 3e-4,
    "own_probability": 2e-4,
    "severity": 3e-6,
    "own_severity": 2e-6,
    "conflict": "merge",
    "speed_mps": 8.0,
    "other_speed_mps": 5.0,
    "arrival_s": 2.0,
    "other_arrival_s": 3.0,
    "angle_deg": 20.0,
    "apart_m": 9.0,
    "acceleration_mps2": -1.0,
    "other_acceleration_mps2": 0.5,
}


def test_an_encounter_is_two_candidates_with_the_roles_exchanged() -> None:
    told, back = candidates_of(ROW)
    assert (told["track_id"], told["other_id"], told["probability"]) == (1, 2, 2e-4)
    assert (back["track_id"], back["other_id"]) == (2, 1)
    assert back["probability"] == pytest.approx(1e-4, rel=1e-3)
    assert back["severity"] == pytest.approx(1e-6)
    assert (back["speed_mps"], back["other_speed_mps"]) == (5.0, 8.0)
    assert (back["arrival_s"], back["angle_deg"]) == (3.0, 20.0)


def test_people_are_not_driven_and_who_cannot_be_hit_is_no_candidate() -> None:
    assert len(candidates_of(ROW | {"person": "pedestrian P1", "track_id": -1})) == 1
    assert len(candidates_of(ROW | {"own_probability": 3e-4})) == 1


def test_hours_are_from_the_first_to_the_last_moment_of_each_recording() -> None:
    rows = [("a", "", 0.0), ("a", "", 1799.0), ("b", "1", 4.0), ("b", "1", None)]
    moments = pa.table(dict(zip(("recording", "case", "time_s"), zip(*rows, strict=True), strict=True)))
    assert recorded_hours(moments, 1.0) == pytest.approx(1801 / 3600)


def test_what_is_no_ranking_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no finished ranking"):
        read_population([tmp_path])
