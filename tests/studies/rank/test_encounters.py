"""Encounters: the same pair in consecutive moments is one, in an order that any column can give."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.encounters import (
    BY_SEVERITY,
    ENCOUNTERS,
    SAID,
    Order,
    StressTest,
    encounters_of,
    leads,
    with_stress,
)
from scex_sumo.studies.rank.exact import ExactScore
from scex_sumo.studies.rank.table import pair_words
from tests.studies.rank.parts import pairs_table


def moment(
    time_s: float, *tables: pa.Table, recording: str = "r", case: str = ""
) -> tuple[MomentRef, pa.Table]:
    name = f"{recording}_{case}_{time_s}"
    ref = MomentRef(moment=name, location="here", recording=recording, case=case, time_s=time_s, vehicles=3)
    return ref, pa.concat_tables(tables)


def found(*moments: tuple[MomentRef, pa.Table], order: Order = BY_SEVERITY) -> list[dict[str, object]]:
    return order.ranked(encounters_of(moments, 1.0)).to_pylist()


def test_consecutive_moments_of_a_pair_are_one_encounter_with_its_most_severe_moment() -> None:
    """Whoever acts; the gap is the least of all moments."""
    rows = found(
        moment(1.0, pairs_table((1, 2), probability=1e-4, gap_m=5.0)),
        moment(2.0, pairs_table((2, 1), probability=3e-4, gap_m=4.0)),
        moment(3.0, pairs_table((1, 2), probability=2e-4, gap_m=3.0)),
    )
    (row,) = rows
    assert (row["track_id"], row["other_id"], row["time_s"], row["seed"]) == (2, 1, 2.0, "r__2.0")
    assert (row["first_s"], row["last_s"], row["moments"], row["gap_m"]) == (1.0, 3.0, 3, 3.0)
    assert (row["probability"], row["severity"], row["rank"]) == (3e-4, pytest.approx(3e-5), 1)


def test_people_are_the_same_by_name_though_their_numbers_change() -> None:
    first = pairs_table((-1, 2), person="pedestrian P7")
    rows = found(moment(1.0, first), moment(2.0, pairs_table((-3, 2), person="pedestrian P7")))
    assert [(row["person"], row["moments"]) for row in rows] == [("pedestrian P7", 2)]
    assert len(found(moment(1.0, first), moment(2.0, pairs_table((-1, 2), person="pedestrian P8")))) == 2


def test_a_moment_without_the_pair_ends_its_encounter() -> None:
    pair = pairs_table((1, 2))
    assert len(found(moment(1.0, pair), moment(3.0, pair))) == 2


def test_recordings_and_cases_are_apart_and_so_are_pairs() -> None:
    pair = pairs_table((1, 2))
    others = moment(2.0, pair, recording="s"), moment(1.0, pair, case="1"), moment(2.0, pair, case="2")
    assert len(found(moment(1.0, pair), *others)) == 4
    assert len(found(moment(1.0, pairs_table((1, 2), (1, 3), (2, 3))))) == 3


def test_the_order_is_by_severity_then_by_any_column() -> None:
    tables = [
        pairs_table((1, 2), probability=1e-4, severity=1e-5, time_to_react=0.5),
        pairs_table((3, 1), probability=3e-4, severity=2e-6, time_to_react=None),
        pairs_table((2, 3), probability=2e-4, severity=3e-6, time_to_react=0.2),
    ]

    def pairs(order: Order) -> list[tuple[object, object]]:
        return [(row["track_id"], row["other_id"]) for row in found(moment(1.0, *tables), order=order)]

    assert pairs(BY_SEVERITY) == [(1, 2), (2, 3), (3, 1)]
    assert pairs(Order(by="probability")) == [(3, 1), (2, 3), (1, 2)]
    assert pairs(Order(by="time_to_react")) == [(2, 3), (1, 2), (3, 1)]  # little time first, none last


def test_doubtful_encounters_are_last_and_without_rank_unless_they_are_kept() -> None:
    both = moment(
        1.0,
        pairs_table((1, 2), probability=1e-1, doubt="boxes touch"),
        pairs_table((1, 3), probability=1e-4),
    )
    assert [(row["rank"], row["doubt"]) for row in found(both)] == [(1, None), (None, "boxes touch")]
    kept = found(both, order=Order(keep_doubtful=True))
    assert [(row["rank"], row["doubt"]) for row in kept] == [(1, "boxes touch"), (2, None)]


def test_what_one_vehicle_does_to_several_at_a_time_is_one_line() -> None:
    """1 goes on before 2, 3 and 4, before 3 a second later; 2 acts by itself; 1 again a minute later."""
    rows = found(
        moment(1.0, pairs_table((1, 2), probability=3e-4), pairs_table((1, 4), probability=1e-4)),
        moment(2.0, pairs_table((1, 2), probability=1e-4), pairs_table((1, 3), probability=2e-4)),
        moment(2.0, pairs_table((2, 3), probability=1.5e-4), recording="s"),
        moment(60.0, pairs_table((1, 2), probability=1e-5)),
    )
    said = [(row["rank"], row["track_id"], row["other_id"], row["more"]) for row in rows]
    assert said == [(1, 1, 2, 2), (1, 1, 3, None), (1, 1, 4, None), (2, 2, 3, 0), (3, 1, 2, 0)]
    table = BY_SEVERITY.ranked(encounters_of([moment(1.0, pairs_table((1, 2), (1, 3)))], 1.0))
    (lead,) = leads(table).to_pylist()
    assert pair_words(lead) == "2 → 1 and 1 more"


def test_a_moment_without_doubt_stands_for_its_encounter() -> None:
    (row,) = found(
        moment(1.0, pairs_table(probability=1e-1, doubt="short")), moment(2.0, pairs_table(probability=1e-4))
    )
    assert (row["time_s"], row["doubt"], row["moments"]) == (2.0, None, 2)


def test_what_is_usual_is_the_median_of_the_class() -> None:
    """21 merges with P of 1e-5 to 21e-5; the ring is compared with all 22."""
    merges = [pairs_table((1, k), probability=(k - 1) * 1e-5) for k in range(2, 23)]
    rows = found(moment(1.0, *merges, pairs_table((90, 91), probability=1e-3, kind="ring")))
    ring, merge = rows[0], rows[1]
    assert (merge["usual_what"], merge["usual_rank"], merge["usual_of"]) == ("at this site", 1, 21)
    assert merge["times_usual"] == pytest.approx(21 / 11)
    assert (ring["usual_what"], ring["usual_rank"], ring["usual_of"]) == ("in the whole data set", 1, 22)


def test_a_verdict_is_of_the_encounter_at_its_time_and_a_data_error_is_doubtful() -> None:
    def given(verdict: str, time_s: float) -> dict[str, str]:
        key = {"recording": "r", "case": "", "track_id": "2", "other_id": "1", "time_s": str(time_s)}
        return key | {"verdict": verdict, "note": "look"}

    pair = pairs_table((1, 2))
    moments = moment(1.0, pair), moment(2.0, pair), moment(9.0, pair)
    rows = found(*moments, order=Order(triage=[given("test", 2.0)]))
    assert [(row["first_s"], row["verdict"], row["note"]) for row in rows] == [
        (1.0, "test", "look"),
        (9.0, None, None),
    ]
    rows = found(*moments, order=Order(triage=[given("test", 2.0), given("data error", 1.0)]))
    assert [(row["first_s"], row["rank"], row["doubt"]) for row in rows] == [
        (9.0, 1, None),
        (1.0, None, SAID),
    ]


def test_an_order_by_something_else_is_refused() -> None:
    with pytest.raises(UsageError, match="--by: got 'mixed'; known: rank, track_id"):
        Order(by="mixed")
    with pytest.raises(UsageError, match="--first 32"):
        Order(by="stress_p_collision").check(0)
    Order(by="stress_p_collision").check(32)


def test_futures_of_the_moment_say_how_often_the_pair_collides() -> None:
    futures = [np.array([[2, 1, 1, 500, 0]]), np.array([[1, 2, 0, 0, 0]]), np.zeros((0, 5), np.int64)]
    rows = encounters_of([moment(1.0, pairs_table((1, 2), (1, 3))), moment(9.0, pairs_table((1, 2)))], 1.0)
    table = with_stress(rows, {"r__1.0": StressTest.of([*futures, futures[2]], None)}).to_pylist()
    by_pair = {(row["time_s"], row["other_id"]): row["stress_p_collision"] for row in table}
    assert by_pair == {(1.0, 2): 0.25, (1.0, 3): 0.0, (9.0, 2): None}
    exact = ExactScore(
        mean=0,
        predicted=[],
        settled=True,
        p_collision=0.2,
        pairs=[(1, 2, "collision", 0.2)],
        extra=70,
        checked=4,
    )
    assert StressTest.of([*futures, futures[2]], exact).events == {(1, 2): (0.2, 0.5)}


def test_a_dataset_without_pairs_has_no_encounter() -> None:
    assert encounters_of([], 1.0).equals(ENCOUNTERS.empty_table())
    assert found(moment(1.0, pairs_table().slice(0, 0))) == []
