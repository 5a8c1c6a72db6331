"""The number: sums by weight, intervals that hold, and what nothing seen means."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.suites.choice import choose
from scex_sumo.suites.estimate import rate, total
from tests.suites.populations import population

ONE = np.zeros(4, dtype=np.int64)


def test_a_rate_is_the_weighted_sum_over_the_hours() -> None:
    y, weight = np.array([0.1, 0.2, 0.3, 0.4]), np.full(4, 25.0)
    found = rate(y, weight, ONE, np.array([100]), 5.0, most=np.ones(4))
    assert found.value == pytest.approx(25.0 / 5.0)
    assert found.deviation == pytest.approx(np.sqrt(0.96 * 4 * np.var(25 * y, ddof=1)) / 5)
    assert found.low < found.value < found.high
    assert found.high / found.value == pytest.approx(found.value / found.low)
    assert found.freedom == 3


def test_variance_of_one_stratum_has_few_degrees_of_freedom() -> None:
    """Two strata of two and ten cases; in the large one all are alike."""
    y, stratum = np.array([0.1, 0.5, *np.full(10, 0.2)]), np.repeat([0, 1], [2, 10])
    _, _, freedom = total(y, np.full(12, 10.0), stratum, np.array([20, 100]))
    assert freedom == pytest.approx(1.0)


def test_a_whole_stratum_has_the_variance_of_its_futures_alone() -> None:
    y, drawn = np.array([0.1, 0.9]), np.array([0.01, 0.02])
    value, variance, _ = total(y, np.ones(2), np.zeros(2, dtype=np.int64), np.array([2]), drawn)
    assert (value, variance) == (pytest.approx(1.0), pytest.approx(0.03))


def test_nothing_seen_is_bounded_by_the_rule_of_three() -> None:
    found = rate(np.zeros(4), np.full(4, 25.0), ONE, np.array([100]), 5.0, most=np.full(4, 0.2))
    assert (found.value, found.low) == (0.0, 0.0)
    assert found.high == pytest.approx(3 / 4 * 100 * 0.2 / 5)


def test_a_difference_to_a_known_rate_may_have_either_sign() -> None:
    found = rate(np.array([0.1, 0.2, 0.3, 0.4]), np.full(4, 25.0), ONE, np.array([100]), 5.0, most=np.ones(4))
    apart = found.less(5.5)
    assert apart.value == pytest.approx(-0.5)
    assert (apart.low, apart.high) == pytest.approx((found.low - 5.5, found.high - 5.5))
    assert apart.low < 0 < apart.high


def test_intervals_of_choices_hold_in_95_percent() -> None:
    """100 choices of 24 from 200: at least 90 %; the binomial's 2.5 % quantile of 95 % is 90 %."""
    people = population(200, seed=3)
    y = people.column("probability") * (1 + people.column("speed_mps"))
    truth, held = float(y.sum()) / 2, 0
    for seed in range(100):
        chosen = choose(people, 24, seed=seed)
        found = rate(
            y[chosen.index], chosen.weight, chosen.stratum, chosen.sizes, 2.0, most=np.ones(len(chosen))
        )
        held += found.low <= truth <= found.high
    assert held / 100 >= 0.90


def test_one_case_that_stands_for_others_has_no_sure_number() -> None:
    one = np.array([0.1])
    found = rate(one, np.array([2.0]), np.zeros(1, dtype=np.int64), np.array([2]), 1.0, most=one)
    assert found.low < 0.1 < 0.2 < 0.4 < found.high
