"""Encounters: the same pair in consecutive moments is one, the most probable first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.encounters import DATA_ERROR_DOUBT, ranked
from tests.studies.moments.pairs import moment, pairs_table


def found(*moments: tuple[MomentRef, pa.Table], triage: Sequence[Mapping[str, str]] = ()) -> list[Any]:
    return ranked(encounters_of(moments, 1.0), triage).to_pylist()


def test_the_order_is_by_probability_or_by_any_column() -> None:
    tables = [
        pairs_table((1, 2), probability=1e-4, time_margin=0.5),
        pairs_table((3, 1), probability=3e-4, time_margin=None),
        pairs_table((2, 3), probability=2e-4, time_margin=0.2),
    ]

    def pairs(**order: str) -> list[tuple[object, object]]:
        encounters = ranked(encounters_of([moment(1.0, *tables)], 1.0), **order)
        return [(row["track_id"], row["other_id"]) for row in encounters.to_pylist()]

    assert pairs() == [(3, 1), (2, 3), (1, 2)]
    assert pairs(by="time_margin") == [(2, 3), (1, 2), (3, 1)]  # small margins first, none last
    for unknown in ("mixed", "stress_p_collision"):
        with pytest.raises(UsageError, match=r"^--by: got"):
            pairs(by=unknown)


def test_doubtful_encounters_are_last_and_without_rank() -> None:
    both = moment(
        1.0, pairs_table((1, 2), probability=1e-1, doubt="boxes touch"), pairs_table((1, 3), probability=1e-4)
    )
    assert [(row["rank"], row["doubt"]) for row in found(both)] == [(1, None), (None, "boxes touch")]


def test_a_verdict_is_of_the_encounter_at_its_time_and_a_data_error_is_doubtful() -> None:
    def given(verdict: str, time_s: float) -> dict[str, str]:
        key = {"recording": "r", "case": "", "track_id": "2", "other_id": "1", "time_s": str(time_s)}
        return key | {"verdict": verdict, "note": "look"}

    pair = pairs_table((1, 2))
    moments = moment(1.0, pair), moment(2.0, pair), moment(9.0, pair)
    rows = found(*moments, triage=[given("test", 2.0)])
    assert [(row["first_s"], row["verdict"], row["note"]) for row in rows] == [
        (1.0, "test", "look"),
        (9.0, None, None),
    ]
    rows = found(*moments, triage=[given("test", 2.0), given("data error", 1.0)])
    assert [(row["first_s"], row["rank"], row["doubt"]) for row in rows] == [
        (9.0, 1, None),
        (1.0, None, DATA_ERROR_DOUBT),
    ]
