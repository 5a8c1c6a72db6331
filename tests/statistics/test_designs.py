"""Designs: how evenly assignments are spread, by counting."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from scex_sumo.base.arrays import IntArray
from scex_sumo.extrapolation.assignments import assignments
from scex_sumo.statistics.designs import balanced

SIX = [1 / 6] * 6


def counts(rows: IntArray, factors: tuple[int, ...], levels: int) -> IntArray:
    """How often each combination of the levels of some factors occurs."""
    flat = np.ravel_multi_index(rows[:, factors].T, (levels,) * len(factors))
    return np.bincount(flat, minlength=levels ** len(factors))


@pytest.mark.parametrize("seed", range(5))
def test_36_balanced_runs_of_6_models_for_2_vehicles_have_each_pair_once(seed: int) -> None:
    rows = balanced([SIX, SIX], 36, np.random.default_rng(seed))
    assert (counts(rows, (0, 1), 6) == 1).all()


def test_all_combinations_come_before_any_comes_twice() -> None:
    rows = balanced([[0.5, 0.5]] * 3, 24, np.random.default_rng(0))
    for first in (0, 8, 16):
        assert len({tuple(r) for r in rows[first : first + 8].tolist()}) == 8


@pytest.mark.parametrize("seed", range(3))
def test_wherever_one_stops_no_model_is_far_ahead_of_another(seed: int) -> None:
    rows = balanced([SIX] * 5, 200, np.random.default_rng(seed))
    so_far = np.stack([np.cumsum(rows == m, axis=0) for m in range(6)], axis=-1)
    assert np.ptp(so_far, axis=-1).max() <= 5  # independent draws: a spread of about 15 after 200 runs


def test_pairs_of_models_are_ten_times_as_even_as_independent_draws() -> None:
    # Independent draws have a variance of the counts of nearly their mean, n / 36 = 5.
    rows = balanced([SIX] * 5, 180, np.random.default_rng(1))
    variances = [counts(rows, pair, 6).var() for pair in combinations(range(5), 2)]
    assert np.mean(variances) < 0.5
    independent = np.random.default_rng(1).integers(0, 6, (180, 5))
    assert np.mean([counts(independent, pair, 6).var() for pair in combinations(range(5), 2)]) > 4


def test_shares_are_met_per_vehicle_and_per_pair() -> None:
    rows = balanced([[0.75, 0.25], [0.5, 0.5]], 64, np.random.default_rng(2))
    assert np.abs(counts(rows, (0, 1), 2) - [24, 24, 8, 8]).max() <= 1


def test_a_shorter_balanced_design_begins_a_longer_one() -> None:
    long = balanced([SIX] * 4, 90, np.random.default_rng(3))
    assert np.array_equal(balanced([SIX] * 4, 50, np.random.default_rng(3)), long[:50])


def test_every_single_row_of_a_balanced_design_is_as_likely_as_in_independent_draws() -> None:
    # 600 designs: the 4 outcomes of row 3 of two vehicles have a count of 150 +- 10.6 each; 5 sigma.
    rows = np.stack([balanced([[0.5, 0.5]] * 2, 4, np.random.default_rng([4, i]))[3] for i in range(600)])
    assert np.abs(counts(rows, (0, 1), 2) - 150).max() < 53


@pytest.mark.parametrize(("vehicles", "futures"), [(1, 1), (1, 7), (3, 1), (9, 40)])
def test_there_are_as_many_futures_as_asked_for(vehicles: int, futures: int) -> None:
    picked = assignments([1, 0, 2], range(vehicles), futures=futures, seed=0)
    assert picked.shape == (futures, vehicles)
    assert set(np.unique(picked)) <= {0, 2}
    again = assignments([1, 0, 2], range(vehicles), futures=futures, seed=0)
    assert np.array_equal(picked, again)
    if futures * vehicles > 300:
        other = assignments([1, 0, 2], range(vehicles), futures=futures, seed=1)
        assert not np.array_equal(picked, other)


def test_a_fixed_vehicle_takes_no_part_in_the_draw() -> None:
    picked = assignments([1, 1], [4, 9, 2], futures=20, seed=0, fixed={9: 2})
    assert (picked[:, 1] == 2).all()
    assert np.array_equal(picked[:, [0, 2]], assignments([1, 1], [4, 2], futures=20, seed=0))
    all_fixed = assignments([1, 1], [4], futures=3, seed=0, fixed={4: 1})
    assert all_fixed.tolist() == [[1]] * 3
