"""The number: sums by weight, intervals that hold, and how many cases narrow ones need."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scex_sumo.suites.catalogue import choose
from scex_sumo.suites.estimate import Design, Rate
from tests.suites.populations import population

NONE = np.zeros(4)


def plain(count: int, of: int, hours: float = 5.0) -> Design:
    """Return a design of some drawn equally of others."""
    share = count / of
    return Design(
        weight=np.full(count, 1 / share),
        chance=np.full(count, share),
        stratum=np.zeros(count, dtype=np.int64),
        hours=hours,
    )


def test_a_rate_is_the_weighted_sum_over_the_hours() -> None:
    y = np.array([0.1, 0.2, 0.3, 0.4])
    found = plain(4, 100).rate(y, NONE)
    assert found.value == pytest.approx(25.0 / 5.0)
    assert found.deviation == pytest.approx(np.sqrt(0.96 * 4 * np.var(25 * y, ddof=1)) / 5)
    assert found.low < found.value < found.high
    assert found.freedom == 3


def test_no_end_is_beyond_a_contact_in_every_encounter() -> None:
    found = plain(4, 100).rate(np.array([0.9, 0.0, 0.0, 0.0]), NONE)
    assert found.high == 100 / 5
    apart = plain(4, 100).difference(np.array([0.9, -0.8, 0.7, -0.9]), NONE)
    assert (apart.low, apart.high) == (-100 / 5, 100 / 5)


def test_variance_of_one_kind_has_few_degrees_of_freedom() -> None:
    """Two kinds of two and ten cases; in the large one all are alike."""
    y, stratum = np.array([0.1, 0.5, *np.full(10, 0.2)]), np.repeat([0, 1], [2, 10])
    design = Design(weight=np.full(12, 10.0), chance=np.full(12, 0.1), stratum=stratum, hours=1.0)
    assert design.total(y, np.zeros(12))[2] == pytest.approx(1.0)


def test_cases_taken_for_sure_have_the_variance_of_their_futures_alone() -> None:
    value, variance, _ = plain(2, 2).total(np.array([0.1, 0.9]), np.array([0.01, 0.02]))
    assert (value, variance) == (pytest.approx(1.0), pytest.approx(0.03))


def test_a_case_that_stands_for_others_alone_has_no_sure_number() -> None:
    found = plain(1, 10, hours=1.0).rate(np.array([0.01]), np.zeros(1))
    assert found.low < 0.02 and found.high > 1.0


def test_kinds_with_one_case_are_one_group() -> None:
    design = Design(
        weight=np.full(4, 10.0), chance=np.full(4, 0.1), stratum=np.array([0, 0, 1, 2]), hours=1.0
    )
    _, variance, freedom = design.total(np.array([0.1, 0.1, 0.3, 0.5]), np.zeros(4))
    assert variance == pytest.approx(0.9 * 2 * np.var([3.0, 5.0], ddof=1))
    assert freedom == pytest.approx(1.0)


def test_a_difference_may_have_either_sign_and_is_0_for_equals() -> None:
    found = plain(4, 100).difference(np.array([0.1, -0.2, 0.3, -0.4]), NONE)
    assert found.low < found.value < 0 < found.high
    same = plain(4, 100).difference(NONE, NONE)
    assert (same.low, same.value, same.high) == (0.0, 0.0, 0.0)


def test_cases_of_a_kind_stand_for_failed_ones() -> None:
    whole = Design(
        weight=np.array([10.0, 30.0, 5.0]),
        chance=np.array([0.1, 0.1, 0.2]),
        stratum=np.array([0, 0, 1]),
        hours=1.0,
    )
    part = whole.part(np.array([True, False, True]))
    assert part.weight.tolist() == [40.0, 5.0]
    assert part.chance == pytest.approx([0.025, 0.2])


def test_intervals_of_choices_hold_in_95_percent() -> None:
    """100 choices of 24 from 200: at least 90 %; the binomial's 2.5 % quantile of 95 % is 90 %."""
    people = population(200, seed=3)
    y = people.column("probability") * np.random.default_rng(0).lognormal(0.0, 1.0, 200)
    truth, held = float(y.sum()) / 2, 0
    for seed in range(100):
        index, chance = choose(people, 24, seed=seed)
        design = Design(weight=1 / chance, chance=chance, stratum=people.kind[index], hours=2.0)
        found = design.rate(y[index], np.zeros(len(index)))
        held += found.low <= truth <= found.high
    assert held / 100 >= 0.90


def test_wide_intervals_say_how_many_cases_a_narrow_one_needs() -> None:
    """With a standard error of the value, log(3) is 2 · 1.96 standard errors of 12.7 times the cases."""
    wide = Rate(value=1.0, low=0.05, high=20.0, deviation=1.0, freedom=5.0)
    assert wide.cases_needed(12) == math.ceil(12 * (2 * 1.959964 / math.log(3)) ** 2) == 153
    assert Rate(value=1.0, low=0.2, high=5.0, deviation=0.8, freedom=5.0).cases_needed(12) is None
