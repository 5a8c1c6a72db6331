"""Decision: which pair of a moment is to be tested, and the sentence that says so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.certainty.response.decision import HARD, SEVERE, UNAVOIDED, decide, pair_responses
from scex_sumo.certainty.response.sensitivity import varied
from scex_sumo.scene import Obstacles, States
from tests.queues import queues


def row(one: int, other: int, **values: Any) -> dict[str, Any]:
    """Return a row of ``response.parquet``: ``one`` acts, ``other`` responds."""
    usual = {"probability": 1e-5, "probability_hard": 1e-6, "expected_mais3": 1e-8, "preventable": True}
    place = {"kind": "lane", "time_s": 2.0, "doubt": None}
    return {"track_id": one, "other_id": other, **usual, **place, **values}


def dangerous(one: int, other: int, **values: Any) -> dict[str, Any]:
    return row(one, other, **{"probability": 1 / 70, "probability_hard": 2 * HARD, **values})


def test_the_sentence_names_pair_place_time_and_what_is_usual() -> None:
    usual = {"usual": 1e-4, "usual_rank": 1, "usual_of": 40, "usual_what": "at this site"}
    found = decide([row(1, 2), dangerous(489, 717, kind="merge", expected_mais3=1e-6, **usual)])
    assert (found.kind, found.pair, found.place, found.time_s) == ("test", (717, 489), "merge", 2.0)
    assert found.sentence == (
        "Test 717 → 489 (merge, 2.0 s): people collide here once in 70; usual at this site: once in 10 000."
    )


def test_what_a_careful_driver_avoids_and_people_hit_once_in_10_000_is_not_to_be_tested() -> None:
    found = decide([row(1, 2, probability=1e-4, probability_hard=HARD / 5)])
    assert found.kind == "nothing"
    assert found.sentence == (
        "Nothing to test: people collide in the worst pair, 2 → 1, once in 10 000, but hardly ever hard, "
        "and a careful driver avoids it."
    )


@pytest.mark.parametrize(
    "values",
    [
        {"probability_hard": 1.01 * HARD},
        {"probability_hard": 1.01 * UNAVOIDED, "preventable": False},
        {"expected_mais3": 1.01 * SEVERE},
    ],
)
def test_a_hard_an_unavoidable_or_a_severe_collision_is_to_be_tested(values: dict[str, Any]) -> None:
    assert decide([row(1, 2, **values)]).kind == "test"
    less = {name: value * 0.98 if isinstance(value, float) else value for name, value in values.items()}
    assert decide([row(1, 2, **less)]).kind == "nothing"


def test_a_doubtful_pair_decides_only_if_no_other_is_to_be_tested() -> None:
    doubtful = dangerous(118, 154, doubt="154 and 118 overlap in the recording", expected_mais3=1.0)
    found = decide([doubtful, row(1, 2)])
    assert found.kind == "doubtful"
    assert found.sentence == "Doubtful data: 154 and 118 overlap in the recording (154 → 118)."
    assert decide([doubtful, dangerous(1, 2)]).pair == (2, 1)
    assert decide([doubtful, dangerous(1, 2)], keep_doubtful=True).pair == (154, 118)
    assert decide([doubtful], keep_doubtful=True).kind == "test"


def test_expected_motions_that_overlap_are_no_doubtful_data() -> None:
    unclear = dangerous(1, 2, doubt="the expected motions of 1 and 2 overlap")
    assert decide([unclear, row(3, 4)]).pair == (4, 3)
    assert decide([unclear]).kind == "nothing"


def test_both_orders_and_all_actions_of_a_pair_count_together() -> None:
    rows = [row(1, 2, probability=0.1), row(2, 1, probability=0.2), row(1, 2, probability=0.5)]
    (found,) = pair_responses([rows[0] | {"preventable": False}, *rows[1:]])
    assert found.probability == pytest.approx(1 - 0.9 * 0.8 * 0.5)
    assert found.row["probability"] == 0.5
    assert not found.preventable


def test_without_encounters_there_is_nothing_to_test() -> None:
    found = decide([])
    assert found.kind == "nothing" and found.pair is None
    assert found.sentence == "Nothing to test: no pair collides as often as once in a billion such moments."


def test_an_error_of_the_data_is_told_where_it_changes_the_decision() -> None:
    rows, other = [dangerous(1, 2)], pair_responses([row(1, 2, probability=1 / 9000)])
    found = decide(rows, varied=lambda pair: [*pair_responses(rows), *other])
    assert found.sentence.endswith(
        "once in 70. This depends on the data: once in 9 000, nothing to test, if boxes are 0.3 m or "
        "headings 2° off."
    )
    assert (found.least, found.most) == pytest.approx((1 / 9000, 1 / 70))
    assert "depends" not in decide(rows, varied=lambda pair: pair_responses(rows)).sentence
    assert (
        "once in 70, to be tested" in decide([row(1, 2)], varied=lambda pair: pair_responses(rows)).sentence
    )


def test_a_larger_box_makes_a_collision_more_probable() -> None:
    scene = queues(2, gap_m=5.0)
    (usual,) = pair_responses(scex.critical_responses(scene).to_pylist())
    smaller, larger, left, right = varied(scene, usual.pair)
    assert smaller.probability < usual.probability < larger.probability
    assert left.probability == pytest.approx(usual.probability, rel=0.2)
    assert left.probability == pytest.approx(right.probability, rel=0.01)  # a straight lane has no sides


def test_a_person_that_decides_varies_as_a_vehicle_does() -> None:
    """People are no tracks of the seed scene: their ids are negative."""
    car, whole = queues(1, speed=8.0), np.ones((1, 11))
    states = States(x=14.0 * whole, y=2.6 * whole, heading=-np.pi / 2 * whole, speed=0.0 * whole)
    person = Obstacles(
        ids=("P1",),
        types=("pedestrian",),
        length=np.array([0.6]),
        width=np.array([0.6]),
        states=states,
        present=whole > 0,
    )
    scene = replace(car, obstacles=person)
    (usual,) = pair_responses(scex.critical_responses(scene).to_pylist())
    assert usual.pair == (1, -1)
    found = varied(scene, usual.pair)
    assert {one.pair for one in found} == {usual.pair}
    assert len({one.probability for one in found}) > 1
