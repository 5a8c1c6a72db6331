"""Assignments are random where asked, complete where asked, and a future's own."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.extrapolation.assignments import (
    all_assignments,
    assignments,
    future_generator,
    random_assignments,
    route_draws,
)


def test_a_futures_assignment_does_not_depend_on_the_other_futures() -> None:
    together = random_assignments([1, 1, 1], range(20), 5, seed=7)
    alone = random_assignments([1, 1, 1], [13], 5, seed=7)
    assert np.array_equal(together[13], alone[0])


def test_models_are_drawn_by_their_weights() -> None:
    drawn = random_assignments([1, 3, 0], range(500), 10, seed=1)
    share = np.bincount(drawn.ravel(), minlength=3) / drawn.size
    # Three standard deviations of a share of 1/4 over 5000 draws.
    assert share[0] == pytest.approx(0.25, abs=3 * np.sqrt(0.25 * 0.75 / 5000))
    assert share[2] == 0


def test_all_assignments_holds_each_combination_once() -> None:
    every = all_assignments([3, 3, 3, 3])
    assert every.shape == (81, 4)
    assert len(np.unique(every, axis=0)) == 81


def test_too_many_combinations_are_refused_with_their_number() -> None:
    with pytest.raises(UsageError, match=r"1.68e\+07 combinations for 12 vehicles"):
        all_assignments([4] * 12)


def test_a_fixed_vehicle_has_its_model_in_every_future() -> None:
    picked = assignments([1, 1], [4, 9, 2], futures=40, seed=0, fixed={9: 2})
    assert (picked[:, 1] == 2).all()
    assert set(np.unique(picked[:, [0, 2]])) == {0, 1}


def test_a_fixed_vehicle_is_left_out_of_the_combinations() -> None:
    picked = assignments([1, 1], [4, 9, 2], futures=None, seed=0, fixed={9: 1})
    assert picked.shape == (4, 3)
    assert (picked[:, 1] == 1).all()


def test_route_draws_are_fixed_per_future_and_apart_from_the_plans_draws() -> None:
    draws = route_draws([3, 4], 6, seed=2)
    assert np.array_equal(draws[1], route_draws([4], 6, seed=2)[0])
    assert not np.array_equal(draws[0], future_generator(2, 3).random(6))
