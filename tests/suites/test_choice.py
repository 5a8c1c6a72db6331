"""Choice of cases: weights sum to the population, the estimate is unbiased, kinds and risk are covered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.suites.choice import EACH, allocation, choose, clusters
from scex_sumo.suites.population import Population
from tests.suites.populations import KINDS, population


def test_weights_are_those_of_strata_and_sum_to_the_candidates_on_average() -> None:
    people = population(300)
    chosen = choose(people, 30)
    assert len(chosen) == 30 == len(set(chosen.index.tolist()))
    assert chosen.sizes.sum() == 300
    assert (chosen.weight >= 1).all()
    assert (chosen.weight[chosen.stratum == 0] == 1).all()  # taken for sure
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


def test_kinds_and_risk_are_strata_and_each_has_cases() -> None:
    people = population(300)
    chosen = choose(people, 48)
    assert set(np.array(people.kinds)[chosen.index]) == set(KINDS)
    assert all((chosen.stratum == h).sum() >= EACH for h in range(1, len(chosen.sizes)))


def rare(count: int) -> Population:
    """Return a population with 5 merges and 3 cyclists among others, of little weight."""
    people = population(count)
    kinds = ["merge"] * 5 + ["cyclist along"] * 3 + ["lead vehicle slower", "head-on"] * count
    rows = [
        row | {"conflict": kind} | ({"probability": 1e-8, "unanswered": 1e-3, "acts": 1e-3} if k < 8 else {})
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


def test_too_few_cases_go_to_the_heaviest_kinds() -> None:
    people = rare(300)
    assert len(choose(people, 2)) == 2
    assert "lead vehicle slower" in set(np.array(people.kinds)[choose(people, 3).index])


def test_few_candidates_are_all_taken_with_weight_one() -> None:
    chosen = choose(population(5), 50)
    assert sorted(chosen.index.tolist()) == [0, 1, 2, 3, 4]
    assert chosen.weight.tolist() == [1.0] * 5


def test_a_moment_gives_one_case_where_its_cluster_has_another() -> None:
    people = population(60)
    rows = [row | {"seed": f"m{k // 2}"} for k, row in enumerate(people.rows)]
    twice = population(60).__class__(**{**vars(people), "rows": rows})
    chosen = choose(twice, 10)
    seeds = [rows[k]["seed"] for k in chosen.index.tolist()]
    assert len(set(seeds)) == len(seeds)


def test_the_same_seed_gives_the_same_cases_and_another_one_others() -> None:
    people = population(100)
    assert choose(people, 10).index.tolist() == choose(people, 10).index.tolist()
    assert choose(people, 10).index.tolist() != choose(people, 10, seed=1).index.tolist()


def test_clusters_have_nearly_one_sum_of_sizes_and_lie_together() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(c, 0.1, (10, 2)) for c in (0.0, 5.0, 10.0)])
    cluster = clusters(points, np.ones(30), 3, rng)
    assert np.bincount(cluster).tolist() == [10, 10, 10]
    assert all(len(set(cluster[k : k + 10])) == 1 for k in (0, 10, 20))
    size = np.repeat([1.0, 4.0], [20, 10])
    sums = np.bincount(clusters(points, size, 3, rng), size)
    assert sums.max() <= sums.sum() / 3 + 4.0


def test_each_stratum_has_two_cases_or_all_and_the_larger_share_more() -> None:
    found = allocation(np.array([100, 100, 1]), np.array([0.6, 0.3, 0.1]), 20, least=np.full(3, EACH))
    assert found.sum() == 20
    assert found[0] > found[1] > found[2] == 1


def test_what_brings_about_most_is_taken_for_sure() -> None:
    people = population(200)
    rows = [row | {"probability": 0.1 if k == 7 else 1e-6} for k, row in enumerate(people.rows)]
    for seed in range(5):
        chosen = choose(people.__class__(**{**vars(people), "rows": rows}), 20, seed=seed)
        assert chosen.weight[chosen.index == 7].tolist() == [1.0]


def test_novelty_is_the_distance_to_the_cases_before() -> None:
    chosen = choose(population(50), 8)
    assert chosen.novelty[0] == 1.0
    assert (np.diff(chosen.novelty[1:]) <= 1e-9).all()


def test_two_cases_are_two_whatever_one_could_bring_about() -> None:
    people = population(20)
    rows = [row | {"probability": 0.1 if k == 7 else 1e-6} for k, row in enumerate(people.rows)]
    assert len(choose(people.__class__(**{**vars(people), "rows": rows}), 2)) == 2


def test_one_case_is_refused() -> None:
    with pytest.raises(UsageError, match="--count: got 1, needs at least 2"):
        choose(population(5), 1)
