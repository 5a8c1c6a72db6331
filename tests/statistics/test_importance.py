"""Importance sampling of rare events: against probabilities in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.models.population import uniforms
from scex_sumo.statistics.collision_search import sample_rare
from scex_sumo.statistics.importance import Outcomes, Sampled, joined, weighted_interval

PLAIN, VEHICLES, COUNT = 117, 3, 4
OTHERS_M = 0.05  # deviation of the gap by the third vehicle, which simulations of the pair do not have

Gap = Callable[[FloatArray], FloatArray]


def number(draw: FloatArray, variable: int) -> FloatArray:
    """(n,) standard normal numbers of vehicles."""
    return np.asarray(ndtri(uniforms(draw, 1, variable)[:, 0]))


def normal(level: float) -> Gap:
    """Normal gap with mean `level` and deviation 1, the third vehicle's included: P(gap <= 0) = Φ(-level)."""
    pair = np.sqrt((1 - OTHERS_M**2) / 2)
    return lambda draw: level - pair * (number(draw[:, 0], 0) - number(draw[:, 1], 1))


class Known:
    """Futures in which the gap of vehicles 0 and 1 is a function of the numbers; plans show four."""

    def __init__(self, gap: Gap) -> None:
        self._gap = gap

    def run(self, draw: FloatArray) -> Outcomes:
        third = OTHERS_M * number(draw[:, 2], 0)
        return outcomes_of(self._gap(draw) + third)

    def pair_gaps(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        assert set(map(tuple, vehicles.tolist())) <= {(0, 1)}
        return self._gap(draw)

    def first_plans(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        columns = [number(draw[:, k], variable) for k in range(len(vehicles)) for variable in range(COUNT)]
        return np.stack(columns, axis=1).reshape(len(draw), len(vehicles), COUNT)

    def features(self, pair: tuple[int, int], plans: FloatArray) -> FloatArray:
        assert pair == (0, 1)
        return plans.reshape(len(plans), -1)


def outcomes_of(gap: FloatArray) -> Outcomes:
    none = np.zeros(len(gap), dtype=np.int64)
    return Outcomes(
        futures=len(gap),
        future=np.arange(len(gap)),
        first=none,
        second=none + 1,
        gap=np.maximum(gap, 0.0),
        collided=gap <= 0,
    )


def sampled(gap: Gap, extra: int, seed: int) -> Sampled:
    draw, futures = np.random.default_rng([seed, 0]).random((PLAIN, VEHICLES)), Known(gap)
    return sample_rare(
        futures,
        draw,
        futures.run(draw),
        extra,
        draws_any=np.ones(VEHICLES, dtype=np.bool_),
        rng=np.random.default_rng([seed, 1]),
    )


@pytest.mark.parametrize(("level", "extra"), [(2.5, 27), (3.1, 100)])
def test_two_vehicles_with_a_known_probability(level: float, extra: int) -> None:
    p, repeats = float(ndtr(-level)), 40
    found = [sampled(normal(level), extra, seed) for seed in range(repeats)]
    values = np.array([one.probability().value for one in found])
    assert abs(values.mean() - p) < 4 * values.std(ddof=1) / np.sqrt(repeats)
    held = sum(one.probability().low <= p <= one.probability().high for one in found)
    assert held >= 34  # of 40: fewer has a probability below 1 % if 95 % hold it
    # Plain futures would scatter by the root of p (1 - p) / n.
    assert values.std() < 0.6 * np.sqrt(p * (1 - p) / (PLAIN + extra))


def test_chosen_futures_collide_often_and_weigh_little() -> None:
    found = sampled(normal(3.1), 100, 0)
    hits, chosen = found.hits(), found.chosen >= 0
    assert hits[chosen].mean() > 100 * ndtr(-3.1) and hits[chosen].sum() > 2
    assert found.weight.max() <= 1 / (~chosen).sum()
    assert np.median(found.weight[hits & chosen]) < 0.1 / len(hits)
    # Vehicle 2 is in no pair.
    assert abs(found.draw[chosen, 2].mean() - 0.5) < 4 * np.sqrt(1 / 12 / chosen.sum())


def test_without_a_hit_the_limit_is_that_of_the_plain_futures() -> None:
    found = sampled(lambda draw: np.full(len(draw), 20.0), 100, 0)
    # No pair is near: all extra futures are plain, and the limit is the rule of three.
    assert not found.pairs and (found.chosen == -1).all()
    share = found.probability()
    assert (share.value, share.low) == (0.0, 0.0)
    assert share.high == pytest.approx(-np.log(0.05) / 217)
    blocked = sampled(lambda draw: 0.5 + np.abs(number(draw[:, 0], 0)), 100, 0)
    assert blocked.simulated > 0
    assert blocked.probability().high == pytest.approx(-np.log(0.05) / 217)


def test_collisions_that_no_simulation_foretells_count_as_in_plain_futures() -> None:
    """Only the third vehicle decides: 5 % of the futures, whatever the pair draws."""

    class Unforeseen(Known):
        def run(self, draw: FloatArray) -> Outcomes:
            return outcomes_of(np.where(draw[:, 2] < 0.05, -1.0, 3.0))

    found = []
    for seed in range(20):  # with few simulations
        draw, futures = np.random.default_rng([seed, 0]).random((PLAIN, VEHICLES)), Unforeseen(normal(2.5))
        every, rng = np.ones(VEHICLES, dtype=np.bool_), np.random.default_rng([seed, 1])
        found.append(
            sample_rare(futures, draw, futures.run(draw), 30, draws_any=every, rng=rng).probability()
        )
    values = np.array([one.value for one in found])
    assert abs(values.mean() - 0.05) < 4 * values.std(ddof=1) / np.sqrt(20)
    assert sum(one.low <= 0.05 <= one.high for one in found) >= 16


def test_if_every_future_collides_the_probability_is_one() -> None:
    share = sampled(lambda draw: np.full(len(draw), -1.0), 100, 0).probability()
    assert share.value == pytest.approx(1.0) and share.high == 1.0 and share.low > 0.8


def test_interval_of_equal_weights_is_that_of_poisson_counts() -> None:
    """Garwood 1936: five counts have the limits 1.623 and 11.668."""
    share = weighted_interval(np.full(5, 0.01), 0.01, 100)
    assert (share.low, share.high) == pytest.approx((0.01623, 0.11668), rel=1e-3)


@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_interval_of_few_weighted_hits_covers(spread: float) -> None:
    rng, covered, expected = np.random.default_rng(0), 0, 12.0
    mean = np.exp(spread**2 / 2)
    for _ in range(1000):
        hits = np.exp(spread * rng.normal(size=rng.poisson(expected))) / mean / 100
        largest = hits.max() if len(hits) else 0.01
        share = weighted_interval(hits, float(largest), 1000)
        covered += share.low <= expected / 100 <= share.high
    assert covered >= 930


def test_outcomes_are_joined_in_order() -> None:
    both = joined([outcomes_of(np.array([1.0, -1.0])), outcomes_of(np.array([-1.0]))])
    assert both.hits().tolist() == [False, True, True]
    assert both.pairs(collided=True) == [(0, 1)] and both.of((0, 1))[0].tolist() == [1.0, 0.0, 0.0]
