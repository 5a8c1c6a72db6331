"""Choice of cases: weights sum to the population, the estimate is unbiased, kinds and risk are covered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.suites.choice import EACH, between, choose
from scex_sumo.suites.population import Population
from tests.suites.populations import KINDS, population


def test_weights_are_those_of_strata_and_sum_to_the_candidates_on_average() -> None:
    people = population(300)
    chosen = choose(people, 30)
    assert len(chosen) == 30 == len(set(chosen.index.tolist()))
    assert chosen.sizes.sum() == 300
    assert (chosen.weight >= 1).all()
    assert chosen.weight[chosen.stratum == 0] == pytest.approx(1.0)  # taken for sure
    sums = [choose(people, 30, seed=k).weight.sum() for k in range(60)]
    assert abs(np.mean(sums) - 300) < 3 * np.std(sums) / np.sqrt(len(sums))


def test_the_weighted_sum_is_unbiased() -> None:
    """Over 100 choices the mean of the estimate is within three standard errors of the sum."""
    people = population(120)
    values = people.column("speed_mps") ** 2
    sums = [
        float((chosen.weight * values[chosen.index]).sum())
        for chosen in (choose(people, 12, seed=k) for k in range(100))
    ]
    assert abs(np.mean(sums) - values.sum()) < 3 * np.std(sums) / np.sqrt(len(sums))


def test_each_kind_is_a_stratum_with_its_share_of_the_cases() -> None:
    people = population(300)
    chosen, kinds, size = choose(people, 48), np.array(people.kinds), people.size()
    assert chosen.strata == ["taken for sure", *sorted(KINDS)][: len(chosen.sizes)]
    for kind in KINDS:
        expected = 48 * size[kinds == kind].sum()
        assert abs((kinds[chosen.index] == kind).sum() - expected) <= 1
        risk = people.risk[chosen.index[kinds[chosen.index] == kind]]
        assert (np.diff(risk) <= 0).all() and risk[0] > risk[-1]  # from high to low


def rare(count: int) -> Population:
    """Return a population with 5 merges and 3 cyclists among others, of little weight."""
    people = population(count)
    kinds = ["merge"] * 5 + ["cyclist along"] * 3 + ["lead vehicle slower", "head-on"] * count
    rows = [
        row | {"conflict": kind} | ({"probability": 1e-8} if k < 8 else {})
        for k, (row, kind) in enumerate(zip(people.rows, kinds, strict=False))
    ]
    return replace(people, rows=rows)


def test_a_rare_kind_has_a_case_in_every_choice() -> None:
    people = rare(300)
    for seed in range(20):
        chosen = choose(people, 20, seed=seed)
        assert len(chosen) == 20
        assert {"merge", "cyclist along"} < set(np.array(people.kinds)[chosen.index])


def test_the_weighted_sum_over_a_rare_kind_is_unbiased() -> None:
    """Over 100 choices the mean is within three standard errors of the sum, for each kind."""
    people = rare(120)
    values, kinds = people.column("speed_mps") ** 2, np.array(people.kinds)
    chosen = [choose(people, 12, seed=k) for k in range(100)]
    for kind in ("merge", "cyclist along", "head-on"):
        own = np.where(kinds == kind, values, 0.0)
        sums = [float((one.weight * own[one.index]).sum()) for one in chosen]
        assert abs(np.mean(sums) - own.sum()) < 3 * np.std(sums) / np.sqrt(len(sums))


def test_kinds_with_one_case_share_a_stratum() -> None:
    chosen = choose(rare(300), 20)
    assert chosen.strata[-1] == "cyclist along, merge"
    assert (chosen.stratum == len(chosen.strata) - 1).sum() == EACH


def test_fewer_cases_than_kinds_leave_kinds_out_by_chance() -> None:
    people = rare(300)
    assert {len(choose(people, 2, seed=seed)) for seed in range(5)} == {2}
    seen = {people.kinds[k] for seed in range(40) for k in choose(people, 2, seed=seed).index.tolist()}
    assert seen == set(people.kinds)


def test_few_candidates_are_all_taken_with_weight_one() -> None:
    chosen = choose(population(5), 50)
    assert sorted(chosen.index.tolist()) == [0, 1, 2, 3, 4]
    assert chosen.weight == pytest.approx(1.0)


def test_the_same_seed_gives_the_same_cases_and_another_one_others() -> None:
    people = population(100)
    assert choose(people, 10).index.tolist() == choose(people, 10).index.tolist()
    assert choose(people, 10).index.tolist() != choose(people, 10, seed=1).index.tolist()


def test_shares_keep_their_bounds_and_their_sum() -> None:
    found = between([6.0, 3.0, 1.0], 1.0, [100.0, 100.0, 1.0], 20)
    assert found == pytest.approx([38 / 3, 19 / 3, 1.0])
    assert between([5.0, 1.0, 1.0], 0.0, 1.0, 2.0) == pytest.approx([1.0, 0.5, 0.5])


def test_what_brings_about_most_is_taken_for_sure() -> None:
    people = population(200)
    rows = [row | {"probability": 0.1 if k == 7 else 1e-6} for k, row in enumerate(people.rows)]
    for seed in range(5):
        chosen = choose(people.__class__(**{**vars(people), "rows": rows}), 20, seed=seed)
        assert chosen.weight[chosen.index == 7] == pytest.approx([1.0])


def test_two_cases_are_two_whatever_one_could_bring_about() -> None:
    people = population(20)
    rows = [row | {"probability": 0.1 if k == 7 else 1e-6} for k, row in enumerate(people.rows)]
    assert len(choose(people.__class__(**{**vars(people), "rows": rows}), 2)) == 2


def test_one_case_is_refused() -> None:
    with pytest.raises(UsageError, match="--count: got 1, needs at least 2"):
        choose(population(5), 1)
