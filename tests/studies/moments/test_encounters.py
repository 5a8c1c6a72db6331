"""Encounters: the same pair in consecutive moments is one, shown at its most probable moment."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.moments.folder import MomentRef
from tests.studies.moments.pairs import moment, pairs_table


def found(*moments: tuple[MomentRef, pa.Table]) -> list[dict[str, Any]]:
    return encounters_of(moments, 1.0).to_pylist()


def test_consecutive_moments_of_a_pair_are_one_encounter_with_its_most_probable_moment() -> None:
    """Whichever of both responds."""
    rows = found(
        moment(1.0, pairs_table((1, 2), probability=1e-4, gap_m=5.0)),
        moment(2.0, pairs_table((2, 1), probability=3e-4, gap_m=4.0)),
        moment(3.0, pairs_table((1, 2), probability=2e-4, gap_m=3.0)),
    )
    (row,) = rows
    assert (row["track_id"], row["other_id"], row["time_s"], row["seed"]) == (2, 1, 2.0, "r__2.0")
    assert (row["first_s"], row["last_s"], row["moments"], row["gap_m"]) == (1.0, 3.0, 3, 4.0)
    assert row["probability"] == 3e-4


def test_people_are_the_same_by_name_though_their_numbers_change() -> None:
    first = pairs_table((2, 901), person="pedestrian P7")
    rows = found(moment(1.0, first), moment(2.0, pairs_table((2, 903), person="pedestrian P7")))
    assert [(row["person"], row["moments"]) for row in rows] == [("pedestrian P7", 2)]
    assert len(found(moment(1.0, first), moment(2.0, pairs_table((2, 901), person="pedestrian P8")))) == 2


def test_recordings_and_cases_are_apart_and_so_are_pairs() -> None:
    pair = pairs_table((1, 2))
    others = moment(2.0, pair, recording="s"), moment(1.0, pair, case="1"), moment(2.0, pair, case="2")
    assert len(found(moment(1.0, pair), *others)) == 4
    assert len(found(moment(1.0, pairs_table((1, 2), (1, 3), (2, 3))))) == 3


def test_a_moment_without_doubt_stands_for_its_encounter() -> None:
    (row,) = found(
        moment(1.0, pairs_table(probability=1e-1, doubt="short")), moment(2.0, pairs_table(probability=1e-4))
    )
    assert (row["time_s"], row["doubt"], row["moments"]) == (2.0, None, 2)
