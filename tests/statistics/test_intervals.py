"""Intervals of a design: the ordinary ones for independent draws, narrower where vehicles are balanced."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import InputError
from scex_sumo.statistics.density import dkw_half_width, wilson_of
from scex_sumo.statistics.designs import balanced
from scex_sumo.statistics.intervals import DesignIntervals
from tests.statistics.shares import equal_shares, wilson

LEVELS, VEHICLES = 4, 5
SHARES = [np.full(LEVELS, 1 / LEVELS)] * VEHICLES
ALL = np.array(list(product(range(LEVELS), repeat=VEHICLES)))


def drawn(count: int, seed: int) -> IntArray:
    return balanced(SHARES, count, np.random.default_rng(seed))


def additive(rows: IntArray) -> FloatArray:
    """Effects of single vehicles only."""
    return np.asarray(rows @ [1.0, -2.0, 0.5, 3.0, -1.0])


def test_all_assignments_leave_nothing_uncertain_not_even_of_a_share_of_1() -> None:
    found = equal_shares(ALL[:16], "all")
    for critical in (np.zeros(16, dtype=bool), np.arange(16) < 3, np.ones(16, dtype=bool)):
        share = found.share(critical)
        assert share.low == share.value == share.high
    assert found.half_width(np.arange(16.0)) == 0
    assert found.half_width(np.full(16, np.nan)) == 1  # defined nowhere: nothing is known


def test_random_draws_have_the_ordinary_intervals() -> None:
    rows = drawn(117, 0)
    found = equal_shares(rows, "random")
    critical = additive(rows) > 3
    ordinary = wilson(int(critical.sum()), 117)
    got = found.share(critical)
    assert (got.value, got.low, got.high) == pytest.approx((ordinary.value, ordinary.low, ordinary.high))
    assert found.half_width(additive(rows)) == dkw_half_width(117)


def test_what_single_vehicles_make_a_balanced_design_knows_nearly_exactly() -> None:
    rows = drawn(128, 1)
    found = equal_shares(rows, "balanced")
    values = additive(rows)[:, None]
    independent = values.var() / 128
    assert found.variance(values)[0] < 0.1 * independent


def test_noise_of_single_futures_is_not_balanced_out() -> None:
    rng = np.random.default_rng(2)
    rows = drawn(300, 2)
    noise = rng.normal(size=(300, 200))
    ratio = equal_shares(rows, "balanced").variance(noise).mean() * 300
    assert ratio == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("count", [117, 385])
def test_coverage_and_width_on_functions_with_interactions(count: int) -> None:
    """Products of two and three vehicles' effects, thresholded: 24 questions, 30 draws of the design."""
    rng = np.random.default_rng(3)
    effects = rng.normal(size=(24, VEHICLES, LEVELS))
    score = np.stack([sum(e[v][ALL[:, v]] for v in range(VEHICLES)) for e in effects], axis=1)
    score += np.stack([np.prod([e[v][ALL[:, v]] for v in (0, 1, 2)], axis=0) for e in effects], axis=1)
    truth_of = score > np.quantile(score, rng.uniform(0.6, 0.95, 24), axis=0).diagonal()
    truth = truth_of.mean(axis=0)
    inside, width, error = [], [], []
    for seed in range(30):
        rows = drawn(count, seed)
        critical = truth_of[np.ravel_multi_index(tuple(rows.T), (LEVELS,) * VEHICLES)]
        for p, found in zip(truth, equal_shares(rows, "balanced").all_shares(critical), strict=True):
            inside.append(found.low <= p <= found.high)
            width.append(found.high - found.low)
            error.append(found.value - p)
    spread = 2 * 1.96 * float(np.std(error))
    assert 0.93 <= np.mean(inside) <= 0.995
    assert np.mean(width) <= 1.5 * spread


def test_a_share_of_0_or_1_keeps_its_interval_of_independent_draws() -> None:
    rows = drawn(117, 4)
    found = equal_shares(rows, "balanced")
    none, every = found.all_shares(np.stack([np.zeros(117, dtype=bool), np.ones(117, dtype=bool)], axis=1))
    assert (none.low, none.high) == (0.0, pytest.approx(wilson(0, 117).high))
    assert (every.low, every.high) == (pytest.approx(wilson(117, 117).low), 1.0)


def test_an_interval_is_never_wider_than_that_of_independent_draws() -> None:
    rng = np.random.default_rng(5)
    rows = drawn(60, 5)
    critical = rng.random((60, 50)) < 0.3
    for hits, found in zip(
        critical.sum(axis=0), equal_shares(rows, "balanced").all_shares(critical), strict=True
    ):
        ordinary = wilson(int(hits), 60)
        assert ordinary.low - 1e-12 <= found.low <= found.high <= ordinary.high + 1e-12


def test_all_assignments_know_the_share() -> None:
    critical = additive(ALL) > 3
    found = equal_shares(ALL, "balanced").share(critical)
    assert found.low == found.value == found.high == critical.mean()


def test_few_futures_and_fixed_vehicles_have_the_ordinary_intervals() -> None:
    assert not equal_shares(drawn(20, 0), "balanced").balanced
    assert not equal_shares(np.tile(ALL, (5, 1)), "balanced").balanced  # over 4096
    assert not equal_shares(np.zeros((100, 3), dtype=np.int64), "balanced").balanced
    assert not equal_shares(np.empty((0, 3), dtype=np.int64), "balanced").balanced


def test_undefined_futures_widen_the_band() -> None:
    rows = drawn(200, 6)
    values = additive(rows)
    found = equal_shares(rows, "balanced")
    some = np.where(np.random.default_rng(0).random(200) < 0.5, np.nan, values)
    assert found.half_width(values) < found.half_width(some) <= dkw_half_width(int(np.isfinite(some).sum()))
    assert found.half_width(np.full(200, np.nan)) == 1.0


def test_long_designs_are_taken_in_blocks() -> None:
    rows = drawn(1100, 7)
    found = equal_shares(rows, "balanced").share(additive(rows) > 3)
    ordinary = wilson(int((additive(rows) > 3).sum()), 1100)
    assert 0 < found.high - found.low < 0.6 * (ordinary.high - ordinary.low)


def test_unequal_weights_are_the_designs_own() -> None:
    shares = [np.array([0.7, 0.2, 0.1])] * 4
    rows = balanced(shares, 150, np.random.default_rng(8))
    values = (rows == 2).sum(axis=1).astype(float)[:, None]
    found = DesignIntervals(rows, design="balanced", shares=shares)
    assert found.variance(values)[0] < 0.05 * values.var() / 150


def test_values_must_be_of_the_designs_futures() -> None:
    with pytest.raises(InputError, match="5 values for the 40 futures"):
        equal_shares(drawn(40, 0), "balanced").share(np.zeros(5, dtype=bool))


def test_an_infinite_number_of_trials_knows_the_share() -> None:
    assert wilson_of(0.3, np.inf) == (0.3, 0.3)
    assert wilson_of(0.3, 40.0) == pytest.approx((wilson(12, 40).low, wilson(12, 40).high))
