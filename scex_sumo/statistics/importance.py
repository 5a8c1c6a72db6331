"""Importance sampling of rare events: futures chosen by a forest, and an interval of few weighted hits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from scipy.special import gammaincinv

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.density import CONFIDENCE, Interval
from scex_sumo.statistics.forest import Forest


def weighted_interval(
    hits: FloatArray, largest: float, number: int, *, variance: float | None = None
) -> Interval:
    """Return Σ hits with a 95 % gamma interval; without hits the upper limit is that of one side.

    Args:
        hits: (k,) weights of the futures with the event.
        largest: weight that the next hit may have at most.
        number: of futures.
        variance: of the sum; None: Σ hits², that of independent futures.

    Source: Fay, Feuer 1997, for sums of Poisson counts with weights.
    """
    tail, value = (1 - CONFIDENCE) / 2, float(hits.sum())
    variance = float((hits**2).sum()) if variance is None else variance
    if not len(hits):
        return Interval(value=0.0, low=0.0, high=min(1.0, -largest * np.log(1 - CONFIDENCE)), count=number)
    low = variance / value * gammaincinv(value**2 / variance, tail)
    value_on, variance_on = value + largest, variance + largest**2
    high = variance_on / value_on * gammaincinv(value_on**2 / variance_on, 1 - tail)
    return Interval(value=min(value, 1.0), low=float(low), high=min(float(high), 1.0), count=number)


def sample_by_score(score: FloatArray, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Draw candidates by their scores, each at most once, with weights that keep shares.

    The scores decide on 80 % of the draws, so no weight is far above 5 / ``count``.

    Args:
        score: (N,) from 0; only ratios matter, and scores of 0 alone give equal chances.
        count: at most N.

    Returns:
        (count,) candidates, ascending, and their weights. These sum to 1; the weighted share of a property
        estimates its share among all candidates.

    Source: Madow 1949 (systematic sampling by size), Hájek 1971 (weights).
    """
    share = np.full(len(score), 1 / len(score))
    if score.sum() > 0:
        share = PLAIN_SHARE * share + (1 - PLAIN_SHARE) * score / score.sum()
    certain = np.zeros(len(score), dtype=np.bool_)
    while True:
        chance = np.where(certain, 1.0, share * (count - certain.sum()) / max(share[~certain].sum(), 1e-12))
        if (chance <= 1).all():
            break
        certain |= chance >= 1
    order = np.lexsort((rng.random(len(score)), score))  # so that weights add up almost the same in each draw
    ends = np.cumsum(chance[order])
    at = np.searchsorted(ends, (rng.random() + np.arange(count)) * ends[-1] / count, side="right")
    drawn = np.sort(order[at])
    return drawn, 1 / chance[drawn] / (1 / chance[drawn]).sum()


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcomes:
    """What happens in N futures: the rows of pairs that come near each other.

    Attributes:
        future: number of the future of each row, from 0; so the vehicles' indices, ``first`` the lower one.
        gap: least gap, m; inf if unknown.
    """

    futures: int
    future: IntArray
    first: IntArray
    second: IntArray
    gap: FloatArray
    collided: BoolArray

    def hits(self) -> BoolArray:
        """Return (N,) whether some pair collides."""
        result = np.zeros(self.futures, dtype=np.bool_)
        result[self.future[self.collided]] = True
        return result

    def of(self, pair: tuple[int, int]) -> tuple[FloatArray, BoolArray]:
        """Return the least gap (N,) of a pair, `FAR_M` if unknown, and whether it collides (N,)."""
        rows = np.flatnonzero((self.first == pair[0]) & (self.second == pair[1]))
        gap, hit = np.full(self.futures, FAR_M), np.zeros(self.futures, dtype=np.bool_)
        gap[self.future[rows]] = np.minimum(self.gap[rows], FAR_M)
        hit[self.future[rows]] = self.collided[rows]
        return gap, hit

    def pairs(self, collided: bool = False) -> list[tuple[int, int]]:
        """Return the pairs that come near each other, or only those that collide."""
        some = self.collided if collided else np.ones(len(self.gap), dtype=np.bool_)
        found = np.unique(np.stack([self.first[some], self.second[some]]), axis=1)
        return list(zip(*found.tolist(), strict=True)) if found.size else []


FAR_M: Final = 10.0
"""Gap of a pair that does not meet, m."""


class Futures(Protocol):
    """Futures that can be run, and what is known of them before.

    The vehicles' numbers (N, V) in [0, 1) are independent; all random variables of a vehicle follow from its
    number.
    """

    def run(self, draw: FloatArray) -> Outcomes:
        """Run futures with numbers (N, V)."""

    def first_plans(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        """Return the first plans (N, W, ...) of W vehicles, which depend on their numbers (N, W) alone."""

    def features(self, pair: tuple[int, int], plans: FloatArray) -> FloatArray:
        """Return features (N, K) of the first plans (N, 2, ...) of a pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Distribution of futures in which the numbers of a pair are chosen by a forest.

    Attributes:
        pair: that shall collide.
        count: of futures that were drawn.
        floor: of the score, which is at most ``cap``.
        mean: of the score over all numbers.
    """

    pair: tuple[int, int]
    count: int
    forest: Forest
    floor: float
    cap: float
    mean: float

    def ratios(self, features: FloatArray, *, fitted: int) -> FloatArray:
        """Return the likelihood ratio (n,), proposal over prior, of futures with features (n, K).

        Args:
            fitted: number of the first futures that the forest was fitted to, as of `Forest.predict`.
        """
        score = self.forest.predict(features, fitted=fitted, power=_POWER) + self.floor
        return np.asarray(np.minimum(score, self.cap) / self.mean)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Futures that estimate a rare event, drawn plainly or chosen.

    Attributes:
        draw: (N, V).
        weight: (N,) by the balance heuristic.
        proposal: (N,) index into ``proposals``; -1 for plain futures.
    """

    draw: FloatArray
    outcomes: Outcomes
    weight: FloatArray
    proposal: IntArray
    proposals: tuple[Proposal, ...]

    def probability(self, pair: tuple[int, int] | None = None) -> Interval:
        """Return the probability that a pair, or any, collides, with a 95 % interval.

        The next hit may have the largest weight of all futures, unless hits are many and their weights alike:
        then the largest one of a hit.
        """
        hit = self.outcomes.hits() if pair is None else self.outcomes.of(pair)[1]
        hits = self.weight[hit]
        many = len(hits) >= SURE_HITS and hits.sum() ** 2 >= SURE_EFFECTIVE * (hits**2).sum()
        largest = float((hits if many else self.weight).max())
        return weighted_interval(hits, largest, len(hit), variance=self._variance(hit))

    def _variance(self, hit: BoolArray) -> float:
        """Return the variance of the sum of weights, clustered by either number of the pairs.

        Chosen futures share numbers, as many pairs are made of few numbers of each vehicle.

        Source: Cameron, Gelbach, Miller 2011.
        """
        result, rows = 0.0, np.flatnonzero(hit)
        for side in (0, 1):
            shared = rows + 2.0  # of no other future; drawn numbers are below 1
            for k, future in enumerate(rows.tolist()):
                if (proposal := self.proposal[future]) >= 0:
                    vehicle = self.proposals[proposal].pair[side]
                    shared[k] = self.draw[future, vehicle]
            _, group = np.unique(shared, return_inverse=True)
            result += float((np.bincount(group, self.weight[rows]) ** 2).sum())
        return result - float((self.weight[rows] ** 2).sum())


PLAIN_SHARE: Final = 0.2
"""Least share of plain futures: it bounds the weights."""

SURE_HITS: Final = 20
SURE_EFFECTIVE: Final = 10.0
"""Hits, and their effective number (Σw)² / Σw², from which their weights bound that of the next hit."""

ROUND: Final = 150
"""Futures of a round; there are up to `MAX_ROUNDS`."""
MAX_ROUNDS: Final = 5
MIN_PAIRS: Final = 2

_NUMBERS = (200, 4000)  # limits of how many of each vehicle are tried: four times the extra futures
_CANDIDATES = 300  # pairs of these numbers for each future that is run, up to
_MOST = 1 << 15
_TAIL = 12  # futures in which a pair is closest
_ELITE = 0.03  # share of the futures, beyond `_TAIL`, that are close
_POWER = 2.0  # of the predicted closeness
_FLOOR = 1e-3  # of the largest score
_MIN_SHARE = 0.1


def sample_rare(
    futures: Futures,
    plain: FloatArray,
    outcomes: Outcomes,
    extra: int,
    *,
    draws_any: BoolArray,
    rng: np.random.Generator,
) -> Sampled:
    """Run futures near collisions beside the plain ones.

    In each round, a forest per pair predicts from the first plans how close a pair comes. Many pairs of
    numbers are drawn, and those that come close are run more often. All futures count. Weights of futures
    that a forest was fitted to come from the trees without them, so that the estimate has no bias.

    Args:
        plain: (N, V) numbers of futures that were drawn plainly, with their outcomes.
        extra: number of futures to run.
        draws_any: (V,) whether a vehicle draws anything.

    Source: multifidelity importance sampling, Peherstorfer et al. 2016.
    """
    rounds = min(1 + extra // ROUND, MAX_ROUNDS)
    tried = rng.random((int(np.clip(4 * extra, *_NUMBERS)), plain.shape[1]))
    search = _Search(futures, plain, outcomes, draws_any, tried)
    for size in np.diff(extra * np.arange(rounds + 1) // rounds).tolist():
        search.run(size, rng)
    return search.sampled()


class _Drawn:
    """Numbers (N, V) of vehicles, and what they plan at first."""

    def __init__(self, futures: Futures, draw: FloatArray) -> None:
        self._futures, self.draw = futures, draw
        self._plans: dict[int, FloatArray] = {}

    def extend(self, draw: FloatArray) -> None:
        """Append numbers (n, V)."""
        known, start = np.array(sorted(self._plans), dtype=np.int64), len(self.draw)
        self.draw = np.concatenate([self.draw, draw])
        if len(known):
            more = self._futures.first_plans(known, draw[:, known])
            for k, vehicle in enumerate(known.tolist()):
                self._plans[vehicle] = np.concatenate([self._plans[vehicle][:start], more[:, k]])

    def know(self, vehicles: IntArray) -> None:
        """Find the first plans of vehicles."""
        new = np.setdiff1d(vehicles, sorted(self._plans))
        if len(new):
            plans = self._futures.first_plans(new, self.draw[:, new])
            self._plans |= {vehicle: plans[:, k] for k, vehicle in enumerate(new.tolist())}

    def features(self, pair: tuple[int, int], one: IntArray | slice, other: IntArray | slice) -> FloatArray:
        """Return the features (n, K) of a pair with numbers in rows (n,) of either vehicle."""
        plans = [self._plans[vehicle][rows] for vehicle, rows in zip(pair, (one, other), strict=True)]
        return self._futures.features(pair, np.stack(plans, axis=1))


class _Search:
    """Futures so far, and the proposals that they were drawn from."""

    def __init__(
        self, futures: Futures, plain: FloatArray, outcomes: Outcomes, draws_any: BoolArray, tried: FloatArray
    ) -> None:
        self._futures, self._draws_any = futures, draws_any
        self._drawn, self._tried = _Drawn(futures, plain), _Drawn(futures, tried)
        self._outcomes = outcomes
        self._which = np.full(len(plain), -1)
        self._chosen = np.zeros(len(plain))  # density of all proposals over that of plain futures
        self._proposals: list[Proposal] = []
        self._most = MIN_PAIRS + len(tried) // 500

    def run(self, size: int, rng: np.random.Generator) -> None:
        """Run another ``size`` futures."""
        pairs, share = self._closest()
        draw, which = rng.random((size, len(self._draws_any))), np.full(size, -1)
        before = len(self._which)
        safe = int(np.ceil(PLAIN_SHARE * (before + size))) - int((self._which < 0).sum())
        first = int(np.clip(safe, 0, size))
        ends = first + np.rint(np.cumsum(share) * (size - first)).astype(np.int64)
        for known in (self._drawn, self._tried):
            known.know(np.unique(np.array(pairs, dtype=np.int64)))
        for pair, end in zip(pairs, ends.tolist(), strict=True):
            if first < end:
                proposal, numbers = self._proposal(pair, end - first, rng)
                draw[first:end, list(pair)] = numbers
                which[first:end] = len(self._proposals)
                self._proposals.append(proposal)
                features = self._drawn.features(pair, slice(None), slice(None))
                self._chosen += proposal.count * proposal.ratios(features, fitted=before)
                first = end
        self._outcomes = joined([self._outcomes, self._futures.run(draw)])
        self._drawn.extend(draw)
        self._which = np.concatenate([self._which, which])
        self._chosen = np.concatenate([self._chosen, np.zeros(size)])
        new = slice(before, None)
        for proposal in self._proposals:
            features = self._drawn.features(proposal.pair, new, new)
            self._chosen[new] += proposal.count * proposal.ratios(features, fitted=0)

    def weights(self) -> FloatArray:
        """Return the weight (N,) of each future by the balance heuristic (Veach, Guibas 1995)."""
        return np.asarray(1.0 / ((self._which < 0).sum() + self._chosen))

    def sampled(self) -> Sampled:
        """Return all futures with their weights."""
        return Sampled(
            draw=self._drawn.draw,
            outcomes=self._outcomes,
            weight=self.weights(),
            proposal=self._which,
            proposals=tuple(self._proposals),
        )

    def _closest(self) -> tuple[list[tuple[int, int]], FloatArray]:
        """Return the pairs that are most likely to collide, and their shares of the next futures.

        The gaps below a small one are exponential, as far as futures show them.
        """
        found: list[tuple[float, tuple[int, int]]] = []
        weight = self.weights()
        for pair in self._outcomes.pairs():
            gap = self._outcomes.of(pair)[0]
            order = np.argsort(gap, kind="stable")[: _TAIL + 1]
            far, w = gap[order[-1]], weight[order[:-1]]
            below = float(w @ (far - gap[order[:-1]]) / w.sum())
            if below > 0 and self._draws_any[list(pair)].any():
                found.append((float(np.sqrt(w.sum() * np.exp(-far / below))), pair))
        found.sort(key=lambda one: (-one[0], one[1]))
        some = [one for one in found[: self._most] if one[0] > _MIN_SHARE * found[0][0]]
        share = np.array([value for value, _ in some])
        return [pair for _, pair in some], share / max(share.sum(), 1e-300)

    def _proposal(
        self, pair: tuple[int, int], count: int, rng: np.random.Generator
    ) -> tuple[Proposal, FloatArray]:
        """Return a proposal, and the numbers (count, 2) that it draws."""
        closeness = _closeness(self._outcomes.of(pair)[0])
        forest = Forest(self._drawn.features(pair, slice(None), slice(None)), closeness, rng)
        numbers = len(self._tried.draw)
        number = np.arange(min(_CANDIDATES * count, _MOST))
        one = number % numbers
        other = rng.permutation(numbers)[(one + number // numbers) % numbers]
        # The mean of powers: fewer trees then have the same expectation.
        predicted = forest.predict(self._tried.features(pair, one, other), fitted=0, power=_POWER)
        floor = _FLOOR * float(predicted.max())
        score = predicted + floor
        # Systematic sampling draws no candidate twice if none has more than its share.
        cap = float(np.sort(score)[-count])
        score = np.minimum(score, cap)
        ends = np.cumsum(score)
        at = np.searchsorted(ends, (rng.random() + np.arange(count)) * ends[-1] / count, side="right")
        at = np.minimum(at, len(score) - 1)
        made = Proposal(pair=pair, count=count, forest=forest, floor=floor, cap=cap, mean=float(score.mean()))
        draw = [self._tried.draw[rows[at], vehicle] for vehicle, rows in zip(pair, (one, other), strict=True)]
        return made, np.stack(draw, axis=1)


def _closeness(gap: FloatArray) -> FloatArray:
    """Return exp(-gap / scale) (n,) from 0 to 1, which is effectively 1 in an elite of the futures."""
    wanted = _TAIL + _ELITE * len(gap)
    low, high = 1e-3, 10 * FAR_M
    for _ in range(30):
        scale = np.sqrt(low * high)
        value = np.exp(-(gap - gap.min()) / scale)
        few = value.sum() ** 2 < wanted * (value**2).sum()
        low, high = (scale, high) if few else (low, scale)
    return np.asarray(np.exp(-(gap - gap.min()) / scale))


def joined(parts: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of several sets of futures, one after the other."""
    starts = np.cumsum([0, *(part.futures for part in parts)])
    names = ("first", "second", "gap", "collided")
    return Outcomes(
        futures=int(starts[-1]),
        future=np.concatenate([part.future + start for part, start in zip(parts, starts, strict=False)]),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
    )
