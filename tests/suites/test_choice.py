"""Choice of cases: each kind, known probabilities, sums without bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.suites.catalogue import between, chances, choose
from scex_sumo.suites.population import Population
from tests.suites.populations import KINDS, population


def uneven(count: int) -> Population:
    """Return a population with 5 merges and 3 cyclists of little weight among others."""
    people = population(count)
    kinds = ["merge"] * 5 + ["cyclist along"] * 3 + ["lead vehicle slower", "head-on"] * count
    rows = [
        row | {"conflict": kind} | ({"probability": 1e-7} if k < 8 else {})
        for k, (row, kind) in enumerate(zip(people.rows, kinds, strict=False))
    ]
    return replace(people, rows=rows)


def test_there_are_as_many_cases_as_asked_for_each_once() -> None:
    chosen, _ = choose(population(300), 30)
    assert len(chosen) == 30 == len(set(chosen.tolist()))


def test_the_weighted_sum_is_unbiased_for_each_kind() -> None:
    """Over 300 choices the mean is within three standard errors of the sum."""
    people = uneven(120)
    values = people.column("probability") * np.random.default_rng(1).uniform(1, 100, len(people))
    chosen = [choose(people, 12, seed=k) for k in range(300)]
    for kind in np.unique(people.kind).tolist():
        own = np.where(people.kind == kind, values, 0.0)
        sums = [float((own[index] / chance).sum()) for index, chance in chosen]
        assert abs(np.mean(sums) - own.sum()) < 3 * np.std(sums) / np.sqrt(len(sums))


def test_a_rare_kind_has_a_case_in_every_choice() -> None:
    people = uneven(300)
    for seed in range(20):
        kinds = {people.rows[k]["conflict"] for k in choose(people, 20, seed=seed)[0].tolist()}
        assert {"merge", "cyclist along"} < kinds


def test_probabilities_sum_to_the_cases_and_in_each_kind_to_one_or_more() -> None:
    people = uneven(300)
    chance = chances(people, 20)
    assert chance.sum() == pytest.approx(20)
    assert (chance > 0).all() and (chance <= 1 + 1e-9).all()
    assert (np.bincount(people.kind, chance)[np.unique(people.kind)] > 1 - 1e-9).all()


def test_with_fewer_cases_than_kinds_each_kind_has_the_same_part() -> None:
    people = uneven(300)
    sums = np.bincount(people.kind, chances(people, 2))
    assert sums[np.unique(people.kind)] == pytest.approx(0.5)


def test_cases_are_of_high_and_of_low_probability() -> None:
    people = population(300)
    p = people.column("probability")
    for low, high in ((1e-6, 1e-5), (1e-5, 1e-4), (1e-4, 1e-3), (1e-3, 1.0)):
        assert ((p >= low) & (p < high))[choose(people, 30)[0]].any()


def test_few_candidates_are_all_taken_for_sure() -> None:
    index, chance = choose(population(5), 50)
    assert sorted(index.tolist()) == [0, 1, 2, 3, 4]
    assert chance == pytest.approx(1.0)


def test_shares_keep_their_bounds_and_their_sum() -> None:
    found = between([6.0, 3.0, 1.0], 1.0, [100.0, 100.0, 1.0], 20)
    assert found == pytest.approx([38 / 3, 19 / 3, 1.0])
    assert between([5.0, 1.0, 1.0], 0.0, 1.0, 2.0) == pytest.approx([1.0, 0.5, 0.5])


def test_what_brings_about_most_is_taken_for_sure() -> None:
    people = population(200)
    rows = [row | {"probability": 0.1 if k == 7 else 1e-6} for k, row in enumerate(people.rows)]
    for seed in range(5):
        index, chance = choose(replace(people, rows=rows), 20, seed=seed)
        assert chance[index == 7] == pytest.approx([1.0])


def test_half_of_an_encounter_is_drawn_half_as_often() -> None:
    people = population(60, probability=1e-4, conflict=KINDS[0])
    rows = [row | {"share": 0.5 if k % 2 else 1.0} for k, row in enumerate(people.rows)]
    chance = chances(replace(people, rows=rows), 10)
    assert chance[::2] == pytest.approx(2 * chance[1::2])


def test_the_same_seed_gives_the_same_cases_and_another_one_others() -> None:
    people = population(100)
    assert choose(people, 10)[0].tolist() == choose(people, 10)[0].tolist()
    assert choose(people, 10)[0].tolist() != choose(people, 10, seed=1)[0].tolist()


def test_one_case_is_refused() -> None:
    with pytest.raises(UsageError, match="--count: got 1, needs at least 2"):
        choose(population(5), 1)
