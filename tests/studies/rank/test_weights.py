"""Weights fitted to the recordings of a ranking stand beside the equal ones of the stress test."""

from __future__ import annotations

import pytest

import scex_sumo
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.rank.table import stress_words
from scex_sumo.studies.rank.weights import RecordingWeights


@pytest.fixture(scope="module")
def recording() -> Recording:
    return scex_sumo.find_recordings([scex_sumo.example_path("roundabout")])[0]


def test_a_recording_is_fitted_once_with_all_its_moments(recording: Recording) -> None:
    found = RecordingWeights(("standard_driver@2", "constant_velocity"))
    fitted = found.of(recording)
    assert fitted is not None and not fitted.before
    assert set(fitted.weights) == {"standard_driver", "constant_velocity"}
    assert sum(fitted.weights.values()) == pytest.approx(1)
    assert found.of(recording) is fitted and not found.notes
    assert found.to_json()[recording.name]["windows"] == fitted.windows


def test_models_that_cannot_be_fitted_leave_a_note(recording: Recording) -> None:
    found = RecordingWeights(("sumo:EIDM", "constant_velocity"))
    assert found.of(recording) is None and found.of(recording) is None
    (note,) = found.notes
    assert note.startswith(f"weights of {recording.name} are not fitted: ") and "SUMO drives" in note


def test_both_shares_are_told_where_they_are_known() -> None:
    row = {"stress_p_collision": 0.1875, "stress_p_fitted": 0.0123}
    assert stress_words(row) == "19% (1.2 % fitted)"
    assert stress_words(row | {"stress_p_fitted": 2e-52}) == "19% (< 0.1 % fitted)"
    assert stress_words(row | {"stress_p_fitted": None}) == "19%"
    assert stress_words(dict.fromkeys(row)) is None
