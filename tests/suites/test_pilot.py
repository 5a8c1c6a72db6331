"""Pilot: candidates drawn by size stand for all, and what it touched is taken for sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.suites.choice import choose
from scex_sumo.suites.pilot import drawn, piloted
from tests.suites.populations import population


def test_candidates_are_drawn_by_size_and_at_most_once() -> None:
    size = np.array([0.5, *np.full(50, 0.01)])
    index, share = drawn(size, ["merge"] * 51, 10, seed=3)
    assert len(index) == 10 == len(set(index.tolist()))
    assert share[index == 0].tolist() == [1.0]  # would be drawn five times
    assert share[index > 0] == pytest.approx(50 / 9)


def test_a_rare_kind_is_among_those_drawn_and_stands_for_itself() -> None:
    """Three of 10 003 candidates, whose size alone would draw them once in 300 pilots."""
    kinds, size = ["merge"] * 10_000 + ["cyclist along"] * 3, np.ones(10_003)
    index, share = drawn(size / size.sum(), kinds, 100, seed=0)
    assert (index >= 10_000).sum() == 3 and share[-3:].tolist() == [1.0, 1.0, 1.0]
    assert share.sum() == pytest.approx(10_003, rel=0.02)


def test_all_are_taken_where_there_are_no_more() -> None:
    index, share = drawn(np.array([0.7, 0.2, 0.1]), ["merge"] * 3, 5, seed=0)
    assert index.tolist() == [0, 1, 2] and share.tolist() == [1.0, 1.0, 1.0]


def test_few_candidates_need_no_pilot() -> None:
    people = population(5)
    assert piloted(people, 5, {}, seed=0) is people


def test_the_weighted_sum_over_both_draws_is_unbiased() -> None:
    """Over 200 choices the mean of the estimate is within three standard errors of the sum."""
    people = population(300)
    values, sums = people.column("speed_mps") ** 2, []
    touched = np.random.default_rng(1).random((300, 2)) ** 8
    for seed in range(200):
        index, share = drawn(people.size(), people.kinds, 60, seed=seed)
        rows = [people.rows[k] for k in index.tolist()]
        chosen = choose(replace(people, rows=rows, share=share, pilot=touched[index]), 12, seed=seed)
        sums.append(float((chosen.weight * values[index[chosen.index]]).sum()))
    assert abs(np.mean(sums) - values.sum()) < 3 * np.std(sums) / np.sqrt(len(sums))


def test_the_only_one_that_the_pilot_touches_is_always_a_case() -> None:
    touched = np.zeros((200, 2))
    touched[7] = 1.0
    people = replace(population(200), pilot=touched)
    assert all(
        choose(people, 20, seed=k).weight[choose(people, 20, seed=k).index == 7] == 1 for k in range(5)
    )
