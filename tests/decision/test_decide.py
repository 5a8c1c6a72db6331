"""Verdicts and their words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.decision.decide import decide
from scex_sumo.decision.law import at_level, error_over_futures, law, over_futures
from scex_sumo.results.decision import Decision
from scex_sumo.results.tables.pairs import NARROW, any_of, once_in, one_in

SHARES = st.floats(0.0, 1.0)


def row(**more: Any) -> dict[str, Any]:
    probability = more.get("probability", 1e-6)
    return {
        "track_id": 1,
        "other_id": 2,
        "person": None,
        "probability": probability,
        "least": probability / 10,
        "most": min(10 * probability, 1.0),
        "what": "rear-end",
        "how": "2 brakes; 1 needs 3.1 m/s²",
        "place": "lane",
        "future": 3,
        "collide": 0.0,
        "conflict_s": 1.2,
        "doubt": None,
    } | more


def verdict(*rows: dict[str, Any], **options: Any) -> Decision:
    ordered = sorted(rows, key=lambda one: -one["probability"])
    return decide(ordered, futures=64, **options)


def test_a_pair_from_one_in_ten_thousand_on_is_tested() -> None:
    decided = verdict(row(probability=1e-4), row(track_id=5, probability=1e-5))
    assert decided.kind == "test" and decided.pair == (1, 2) and decided.probability == 1e-4
    assert decided.sentence.startswith(
        "Test: 1 → 2 (rear-end): 2 brakes; 1 needs 3.1 m/s²; people collide about"
    )
    assert verdict(row(probability=9e-5)).kind == "nothing"
    assert verdict(row(probability=9.6e-5)).kind == "test"  # printed as once in 10 000
    assert verdict(row(probability=9.6e-5, collide=0.5)).kind == "test"


def test_doubtful_pairs_decide_only_where_no_other_is_to_be_tested() -> None:
    doubtful = row(track_id=7, probability=0.5, doubt="7 is off the mapped lanes")
    assert verdict(doubtful, row(probability=1e-3)).pair == (1, 2)
    decided = verdict(doubtful, row(probability=1e-6))
    assert (
        decided.kind == "doubtful" and decided.pair == (7, 2) and decided.doubt == "7 is off the mapped lanes"
    )


def test_where_the_only_pairs_are_doubtful_the_verdict_has_the_doubt() -> None:
    decided = verdict(row(probability=1e-8, doubt="1 is recorded for less than a second"))
    assert decided.kind == "doubtful" and decided.doubt == "1 is recorded for less than a second"


def test_more_futures_that_collide_than_p_says_are_a_dispute() -> None:
    decided = verdict(row(probability=4e-6, collide=1 / 64))
    assert decided.kind == "disagree" and "1 of 64 human-like futures collide" in decided.sentence


def test_nobody_near_is_nothing() -> None:
    decided = verdict()
    assert decided.kind == "nothing" and decided.pair is None and decided.probability == 0


def test_p_outside_of_its_range_is_no_decision() -> None:
    with pytest.raises(AssertionError):
        Decision(kind="test", sentence="", probability=0.5, least=0.1, most=0.2)


@given(contact=st.lists(SHARES, min_size=1, max_size=20), factor=st.floats(1.0, 100.0))
def test_another_level_moves_p_to_its_side_and_leaves_0_and_1(contact: list[float], factor: float) -> None:
    values = np.array(contact)
    more, less = at_level(values, factor), at_level(values, 1 / factor)
    assert np.all(less <= values + 1e-12) and np.all(values <= more + 1e-12)
    assert np.all(more <= 1) and np.all(less >= 0)
    assert np.all(more[values == 1] == 1) and np.all(more[values == 0] == 0)


@given(contact=st.lists(SHARES, min_size=1, max_size=20))
def test_p_over_futures_lies_between_none_and_the_worst_and_is_that_of_equal_ones(
    contact: list[float],
) -> None:
    values, pair = np.array(contact), np.zeros(len(contact), dtype=np.int64)
    p = over_futures(pair, values, pairs=1, futures=len(values))[0]
    assert values.min() - 1e-9 <= p <= values.mean() + 1e-9
    assert over_futures(pair, np.full(len(values), values[0]), pairs=1, futures=len(values))[
        0
    ] == pytest.approx(values[0])


def test_half_of_the_futures_that_collide_are_more_than_a_tenth() -> None:
    half = np.repeat([1.0, 0.0], 8)
    assert over_futures(np.zeros(16, np.int64), half, pairs=1, futures=16)[0] >= 0.1


def conflicts(**more: float) -> Conflicts:
    values: dict[str, Any] = dict.fromkeys(("future", "one", "braking_step", "margin_step", "gap_step"), 0)
    values |= {"two": 1, "braking": 0.0, "margin": np.inf, "gap": 20.0, "meets_rad": np.inf}
    values |= {"brakes_one": True, "later_one": False} | more
    return Conflicts(**{name: np.array([value]) for name, value in values.items()})


def contact(kind: str = "car", **more: float) -> float:
    return float(law().contact(conflicts(**more), (kind, "car"))[0])


def test_the_law_rises_with_the_need_and_falls_with_margin_and_gap() -> None:
    needs = [contact(braking=d) for d in (0.1, 0.5, 1, 2, 4, 6, 7.9)]
    assert needs == sorted(needs) and needs[-1] > 0.5
    margins = [contact(margin=t, gap=3.0) for t in (5.0, 2.0, 1.0, 0.5, 0.1)]
    assert margins == sorted(margins)
    gaps = [contact(gap=g) for g in (30.0, 10.0, 3.0, 1.0, 0.1)]
    assert gaps == sorted(gaps) and gaps[0] > 0


def test_it_is_one_after_a_contact_and_where_more_is_needed_than_one_can() -> None:
    assert contact(gap=0.0) == 1.0 and contact(braking=8.0) == 1.0
    assert contact("truck", braking=6.0) == 1.0 > contact(braking=6.0)


def test_numbers_have_one_digit_and_never_break() -> None:
    assert one_in(1 / 234_567) == f"200{NARROW}000"
    assert once_in(1 / 234_567) == f"about once in 200{NARROW}000 such moments"
    assert once_in(0.53) == f"in about 53{NARROW}% of such moments"
    assert one_in(0.0) == f"1{NARROW}000{NARROW}000{NARROW}000"


@given(st.lists(st.floats(0.0, 0.5), max_size=6))
def test_any_of_some_is_as_if_independent(chances: list[float]) -> None:
    assert any_of(chances) == pytest.approx(1 - np.prod(1 - np.array(chances)), abs=1e-9)


def test_few_futures_that_collide_make_the_range_wide() -> None:
    few, many = (np.array([1.0] * k) for k in (2, 16))
    of = {"pairs": 1, "futures": 16}
    assert error_over_futures(np.zeros(2, np.int64), few, **of)[0] > 3
    assert error_over_futures(np.zeros(16, np.int64), many, **of)[0] == pytest.approx(1.0)
