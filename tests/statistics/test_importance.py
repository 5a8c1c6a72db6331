"""Importance sampling of rare events: against probabilities in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.models.population import uniforms
from scex_sumo.statistics.importance import Outcomes, Sampled, joined, sample_rare, weighted_interval
from scex_sumo.statistics.tilting import UNIFORM_EDGES, Proposal, Variables, normal_classes, weights

PLAIN, VEHICLES, COUNT = 117, 3, 4


def number(draw: FloatArray, variable: int) -> FloatArray:
    """(n,) standard normal numbers of vehicles."""
    return np.asarray(ndtri(uniforms(draw, 1, variable)[:, 0]))


def classes(draw: FloatArray, variable: int) -> IntArray:
    found = np.searchsorted(UNIFORM_EDGES, uniforms(draw, 1, variable)[:, 0], side="right")
    return found.astype(np.int64)


def variables() -> Variables:
    prior, score = normal_classes()
    return Variables(
        words=(("", ""),) * COUNT,
        prior=np.tile(prior, (COUNT, 1)),
        score=np.tile(score, (COUNT, 1)),
        classes=classes,
    )


def pair_with_gap(level: float) -> Callable[[FloatArray], Outcomes]:
    """Vehicles 0 and 1 with a normal gap of mean `level` and deviation 1: P(gap <= 0) = Φ(-level)."""

    def simulate(draw: FloatArray) -> Outcomes:
        gap = level - (number(draw[:, 0], 0) - number(draw[:, 1], 1)) / np.sqrt(2)
        return outcomes_of(gap)

    return simulate


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


def sampled(simulate: Callable[[FloatArray], Outcomes], extra: int, seed: int) -> Sampled:
    draw = np.random.default_rng([seed, 0]).random((PLAIN, VEHICLES))
    return sample_rare(
        variables(),
        simulate,
        draw,
        simulate(draw),
        extra,
        tiltable=np.ones(VEHICLES, dtype=np.bool_),
        generator=lambda stage: np.random.default_rng([seed, stage + 1]),
    )


@pytest.mark.parametrize(("level", "extra"), [(2.5, 117), (3.1, 117), (3.1, 1000)])
def test_two_vehicles_with_a_known_probability(level: float, extra: int) -> None:
    p, repeats = float(ndtr(-level)), 40
    found = [sampled(pair_with_gap(level), extra, seed) for seed in range(repeats)]
    values = np.array([one.probability().value for one in found])
    assert abs(values.mean() - p) < 4 * values.std(ddof=1) / np.sqrt(repeats)
    held = sum(one.probability().low <= p <= one.probability().high for one in found)
    assert held >= 34  # of 40: fewer has a probability below 1 % if 95 % hold it
    # Plain futures would scatter by the root of p (1 - p) / n.
    assert values.std() < 0.5 * np.sqrt(p * (1 - p) / (PLAIN + extra))
    totals = np.array([one.weight.sum() for one in found])
    assert abs(totals.mean() - 1) < 4 * totals.std(ddof=1) / np.sqrt(repeats)


def test_a_tilted_number_has_the_distribution_that_its_ratio_says() -> None:
    made = variables()
    ratio = made.tilted(np.array([1.0, -0.5, 0.0, 0.0]))
    assert (made.prior * ratio).sum(axis=1) == pytest.approx(1.0)
    assert (made.prior * ratio * made.score).sum(axis=1) == pytest.approx([1.0, -0.5, 0.0, 0.0], abs=1e-6)
    proposal = Proposal(vehicles=(1,), ratio=ratio[None], pair=(0, 1))
    count = 20_000
    plain = np.random.default_rng(0).random((count, VEHICLES))
    draw = proposal.draw(made, plain, np.random.default_rng(1))
    assert (draw[:, [0, 2]] == plain[:, [0, 2]]).all()
    for variable in range(COUNT):
        share = np.bincount(classes(draw[:, 1], variable), minlength=len(UNIFORM_EDGES) + 1) / count
        wanted = made.prior[variable] * ratio[variable]
        assert np.abs(share - wanted).max() < 4.5 * np.sqrt(0.25 / count)


def test_weights_are_bounded_by_the_plain_futures_and_average_to_one() -> None:
    made = variables()
    proposal = Proposal(vehicles=(0,), ratio=made.tilted(np.array([1.5, 0, 0, 0]))[None], pair=(0, 1))
    rng = np.random.default_rng(0)
    plain = rng.random((4000, VEHICLES))
    draw = np.concatenate([plain, proposal.draw(made, rng.random((4000, VEHICLES)), rng)])
    found = weights(made, 4000, [proposal], [4000], draw)
    assert found.max() <= 1 / 4000
    assert found.sum() == pytest.approx(1.0, abs=4 * found.std() * np.sqrt(len(found)))


def test_without_a_hit_the_limit_is_that_of_the_plain_futures() -> None:
    found = sampled(lambda draw: outcomes_of(np.full(len(draw), 5.0) + number(draw[:, 0], 0) / 10), 100, 0)
    # No pair is near: all extra futures are plain, and the limit is the rule of three.
    assert not found.proposals and (found.proposal == -1).all()
    share = found.probability()
    assert (share.value, share.low) == (0.0, 0.0)
    assert share.high == pytest.approx(-np.log(0.05) / 217)
    blocked = sampled(lambda draw: outcomes_of(0.3 + np.abs(number(draw[:, 0], 0))), 100, 0)
    assert blocked.proposals and blocked.probability().high <= -np.log(0.05) / 117


def test_if_every_future_collides_the_probability_is_one() -> None:
    share = sampled(lambda draw: outcomes_of(np.full(len(draw), -1.0)), 100, 0).probability()
    assert share.value == pytest.approx(1.0) and share.high == 1.0 and share.low > 0.85


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
