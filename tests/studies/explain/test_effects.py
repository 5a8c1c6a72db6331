"""Whose models explain the values: cases in which the answer is known without a computer."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.statistics.density import wilson
from scex_sumo.statistics.designs import balanced, independent
from scex_sumo.studies.explain.effects import Condition, Effect, all_cells
from scex_sumo.studies.explain.effects import conditions as conditions_of
from scex_sumo.studies.explain.effects import covering as covering_of
from scex_sumo.studies.explain.effects import effects as effects_of

TWO_CUBED = all_assignments([2, 2, 2])


def covering(levels: np.ndarray, critical: np.ndarray, most: int) -> list[Condition]:
    return covering_of(all_cells(levels), critical, most)


def conditions(levels: np.ndarray, critical: np.ndarray) -> list[Condition]:
    return conditions_of(all_cells(levels), critical)


def effects(levels: np.ndarray, values: np.ndarray) -> list[Effect]:
    (found,) = effects_of(levels, np.asarray(values, dtype=float)[:, None])
    return found


def shares(found: list[Effect]) -> dict[tuple[int, ...], float]:
    """Adjusted share by vehicles; () is the rest."""
    return {tuple(v for v in (e.vehicle, e.other) if v >= 0): e.share for e in found}


def test_a_value_of_one_vehicle_only_is_explained_by_it_alone() -> None:
    levels = all_assignments([4, 4, 4])
    found = shares(effects(levels, np.array([3.0, 1.0, 7.0, 2.0])[levels[:, 1]]))
    assert found[(1,)] == pytest.approx(1, abs=1e-12)
    assert max(abs(s) for who, s in found.items() if who != (1,)) < 1e-12


def test_what_two_vehicles_do_only_together_is_their_pair() -> None:
    found = shares(effects(TWO_CUBED, (TWO_CUBED[:, 0] ^ TWO_CUBED[:, 2]).astype(float)))
    assert found[(0, 2)] == pytest.approx(1, abs=1e-12)
    assert max(abs(s) for who, s in found.items() if who != (0, 2)) < 1e-12


def test_what_three_vehicles_do_only_together_is_the_rest() -> None:
    found = shares(effects(TWO_CUBED, (TWO_CUBED.sum(axis=1) % 2).astype(float)))
    assert found[()] == pytest.approx(1, abs=1e-12)


def test_shares_of_a_sum_are_the_shares_of_the_variances() -> None:
    # Variances of 1 * level and 2 * level, levels 0 and 1: 1/4 and 1.
    found = shares(effects(TWO_CUBED, TWO_CUBED[:, 0] + 2.0 * TWO_CUBED[:, 1]))
    assert found[(0,)] == pytest.approx(0.2, abs=1e-12)
    assert found[(1,)] == pytest.approx(0.8, abs=1e-12)


def test_a_maximum_of_two_vehicles_has_a_third_from_each_and_from_both() -> None:
    # max(a, b) of two coins: mean 3/4, variance 3/16; E[max | a] is 1/2 or 1, of variance 1/16.
    found = shares(effects(TWO_CUBED, TWO_CUBED[:, :2].max(axis=1).astype(float)))
    for who in ((0,), (1,), (0, 1)):
        assert found[who] == pytest.approx(1 / 3, abs=1e-12)


@pytest.mark.parametrize("draw", [balanced, independent])
def test_a_sample_finds_the_same_shares_as_all_combinations(draw) -> None:  # type: ignore[no-untyped-def]
    # max of two coins, 400 runs: the standard error of a share is about sqrt(share * 4 / n) < 0.06.
    levels = draw([[0.5, 0.5]] * 4, 400, np.random.default_rng(5))
    found = shares(effects(levels, levels[:, :2].max(axis=1).astype(float)))
    for who in ((0,), (1,), (0, 1)):
        assert found[who] == pytest.approx(1 / 3, abs=0.12)
    assert (2,) not in found


def test_the_shares_of_many_vehicles_sum_to_the_whole() -> None:
    # 60 vehicles and 385 futures: the fits of all vehicles and pairs one by one would sum to far above 1.
    rng = np.random.default_rng(6)
    levels = balanced([[0.25] * 4] * 60, 385, rng)
    collides = (levels[:, 3] == 1) | ((levels[:, 7] == 2) & (levels[:, 8] == 0))
    values = np.stack([collides + 0.0, rng.normal(size=385), levels[:, 5] + rng.normal(size=385)], axis=1)
    every = effects_of(levels, values)
    for found in every:
        assert sum(e.share for e in found) == pytest.approx(1)
        assert min(e.share for e in found) >= 0
        assert sum(e.degrees for e in found) < 385 / 5
    assert {(3,), (7, 8)} <= set(shares(every[0]))
    assert shares(every[0])[()] < 0.1
    # Levels 0 to 3 have the variance 5/4, the noise 1.
    assert shares(every[2])[(5,)] == pytest.approx(5 / 9, abs=0.1)


def test_chance_is_no_effect() -> None:
    # 5 % of the noises may have an effect of a vehicle, and 5 % one of a pair.
    rng = np.random.default_rng(7)
    levels = independent([[0.25] * 4] * 6, 200, rng)
    named = [len(found) > 1 for found in effects_of(levels, rng.normal(size=(200, 200)))]
    assert 0.0 < np.mean(named) < 0.16


def test_only_pairs_that_may_have_an_effect_get_one() -> None:
    levels = independent([[0.5] * 2] * 4, 200, np.random.default_rng(2))
    together = (levels[:, 0] ^ levels[:, 2])[:, None].astype(float)
    (found,) = effects_of(levels, together, pairs={(0, 2)})
    assert shares(found)[(0, 2)] == pytest.approx(1, abs=0.02)
    (found,) = effects_of(levels, together, pairs={(1, 2)})
    assert (0, 2) not in shares(found)


def test_shares_depend_on_neither_unit_nor_names() -> None:
    rng = np.random.default_rng(8)
    levels = independent([[0.25] * 4] * 3, 150, rng)
    values = np.sin(levels[:, 0] * levels[:, 1]) + rng.normal(size=150)
    other_names = np.array([2, 0, 3, 1])[levels]
    first, second = shares(effects(levels, values)), shares(effects(other_names, 5000 - 100 * values))
    for who, share in first.items():
        assert second[who] == pytest.approx(share, abs=1e-9)


def test_undefined_futures_and_fixed_vehicles_are_left_out() -> None:
    levels = np.concatenate([all_assignments([2, 1, 2])] * 10)
    values = levels[:, 0].astype(float)
    values[::7] = np.nan
    found = shares(effects(levels, values))
    # Not quite 1: without some futures the vehicles' models are slightly correlated.
    assert found[(0,)] == pytest.approx(1, abs=0.01)
    assert (1,) not in found


@pytest.mark.parametrize(
    "values",
    [np.full(8, 3.0), np.full(8, np.nan), np.arange(8) * 1e-14 + 5e3],
    ids=["constant", "none", "tiny"],
)
def test_nothing_is_said_of_values_that_do_not_vary(values: FloatArray) -> None:
    assert effects(TWO_CUBED, values) == []


def test_nothing_is_said_of_too_few_futures() -> None:
    levels = independent([[0.25] * 4] * 5, 19, np.random.default_rng(0))
    assert effects(levels, np.arange(19.0)) == []


def test_pairs_are_left_out_where_futures_suffice_for_single_vehicles_only() -> None:
    levels = balanced([[0.25] * 4] * 3, 48, np.random.default_rng(0))
    kinds = {e.kind for e in effects(levels, levels[:, 0] + 1.0 * (levels[:, 0] == levels[:, 1]))}
    assert kinds == {"main", "rest"}


def two_causes() -> tuple[IntArray, np.ndarray]:
    levels = np.concatenate([all_assignments([3, 3, 3])] * 2)
    return levels, (levels[:, 0] == 1) | ((levels[:, 1] == 2) & (levels[:, 2] == 0))


def test_a_condition_counts_the_futures_it_holds_for() -> None:
    levels, critical = (np.concatenate([part] * 4) for part in two_causes())
    found = {(c.vehicles, c.models): c for c in conditions(levels, critical)}
    one = found[(0,), (1,)]
    assert (one.futures, one.critical, one.share) == (72, 72, 1.0)
    assert one.covered == 18 / 22  # 18 futures, and of the other 36 one in nine
    pair = found[(1, 2), (2, 0)]
    assert (pair.futures, pair.critical) == (24, 24)
    assert ((0,), (0,)) not in found  # 8 of 72: fewer than of all
    interval = wilson(72, 72)
    assert (one.low, one.high) == (interval.low, interval.high)


def test_conditions_of_too_few_futures_are_left_out() -> None:
    levels = all_assignments([2, 2, 2])
    assert conditions(levels, levels[:, 0] == 1) == []  # 4 of 4
    levels = np.concatenate([levels] * 10)
    assert {c.futures for c in conditions(levels, levels[:, 0] == 1)} == {20, 40}


def test_the_rules_are_the_causes() -> None:
    levels, critical = two_causes()
    rules = covering(np.concatenate([levels] * 4), np.concatenate([critical] * 4), 5)
    assert [(r.vehicles, r.models) for r in rules] == [((0,), (1,)), ((1, 2), (2, 0))]


def test_there_are_no_rules_where_nothing_or_everything_is_critical() -> None:
    levels, critical = two_causes()
    assert covering(levels, np.zeros_like(critical), 3) == []
    # Of thousands of pairs of models some are critical often by chance: none of them is a rule.
    rng = np.random.default_rng(0)
    many, noise = rng.integers(0, 4, (117, 40)), rng.random(117) < 0.1
    assert conditions(many, noise) == []
    assert covering(many, noise, 3) == []
    assert covering(levels, np.ones_like(critical), 3) == []


def test_columns_explained_together_have_the_effects_of_each_alone() -> None:
    rng = np.random.default_rng(4)
    levels, values = rng.integers(0, 3, (150, 4)), rng.normal(size=(150, 3))
    values[::5, 1] = np.nan
    values[:, 2] = 1.0
    together = effects_of(levels, values)
    assert repr(together) == repr([effects(levels, column) for column in values.T])  # NaN is not NaN
    assert together[2] == [] and together[0][-1].kind == "rest"


def test_values_near_the_largest_number_have_the_shares_of_small_ones() -> None:
    """Their squares would be infinite."""
    rng = np.random.default_rng(5)
    levels, values = rng.integers(0, 2, (100, 3)), rng.uniform(0.1, 1.0, 100)
    small, huge = shares(effects(levels, values)), shares(effects(levels, 1.7e308 * values))
    assert huge == pytest.approx(small)
