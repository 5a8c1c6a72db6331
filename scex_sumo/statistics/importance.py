"""Importance sampling of rare events: near futures by cross-entropy, and an interval of few weighted hits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaincinv, ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, mean_ranks
from scex_sumo.statistics.density import CONFIDENCE, Interval
from scex_sumo.statistics.tilting import Proposal, Variables, weights


def weighted_interval(hits: FloatArray, largest: float, number: int) -> Interval:
    """Return Σ hits with a 95 % gamma interval; without hits the upper limit is that of one side.

    Args:
        hits: (k,) weights of the futures with the event.
        largest: weight that the next hit may have at most.
        number: of futures.

    Source: Fay, Feuer 1997, for sums of Poisson counts with weights.
    """
    tail, value, variance = (1 - CONFIDENCE) / 2, float(hits.sum()), float((hits**2).sum())
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

Simulate = Callable[[FloatArray], Outcomes]
"""Runs futures whose vehicles have numbers (N, V)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Futures that estimate a rare event, without tilt or with it.

    Attributes:
        draw: (N, V).
        weight: (N,) by the balance heuristic.
        proposal: (N,) index into ``proposals``; -1 without tilt.
    """

    draw: FloatArray
    outcomes: Outcomes
    weight: FloatArray
    proposal: IntArray
    proposals: tuple[Proposal, ...]
    pilot: int

    def probability(self, pair: tuple[int, int] | None = None) -> Interval:
        """Return the probability that a pair, or any, collides, with a 95 % interval.

        The next hit may have the largest weight of all futures, unless hits are many and their weights alike:
        then the largest one of a hit.
        """
        hit = self.outcomes.hits() if pair is None else self.outcomes.of(pair)[1]
        hits = self.weight[hit]
        many = len(hits) >= SURE_HITS and hits.sum() ** 2 >= SURE_EFFECTIVE * (hits**2).sum()
        return weighted_interval(hits, float((hits if many else self.weight).max()), len(hit))


MIN_PILOT: Final = 400
"""Futures from which on a third only improves the proposals."""

PLAIN_SHARE: Final = 0.2
"""Least share of futures without tilt: it bounds the weights."""

MIN_HITS: Final = 6
SURE_HITS: Final = 20
SURE_EFFECTIVE: Final = 10.0
"""Hits, and their effective number (Σw)² / Σw², from which their weights bound that of the next hit."""

_MAX_SDS, _LIKELY_SDS = 5.0, 3.0
_MAX_MEAN = 1.8
_AWAY_MEAN = 0.75  # of the score of an inattentive driver: about half of them look away
_CLOSEST = 0.15
_VARIANTS = ((1.0, None, 0.4), (0.5, None, 0.3), (0.7, 0, 0.15), (0.7, 1, 0.15))
"""Scale of the means of a pair, the inattentive driver, and the share of the futures."""

_NOISE = 2.5  # standard errors below which a mean is not believed
_MIN_SHARE = 0.05


def sample_rare(
    variables: Variables,
    simulate: Simulate,
    plain: FloatArray,
    outcomes: Outcomes,
    extra: int,
    *,
    tiltable: BoolArray,
    generator: Callable[[int], np.random.Generator],
) -> Sampled:
    """Run futures near collisions beside the plain ones.

    The proposals follow from plain futures that do not collide and from pilot futures, which do not count in
    the estimate. So they do not depend on the hits that count, and the estimate has no bias.

    Args:
        plain: (N, V) numbers of futures without tilt, with their outcomes.
        extra: number of futures to run.
        tiltable: (V,) whether a vehicle's model has these variables.
        generator: random numbers of each round.
    """
    count, vehicles = plain.shape
    rounds = 2 if extra >= MIN_PILOT else 0
    pilots = [extra // 6] * rounds
    proposals = _first_proposals(variables, plain, outcomes, tiltable, 4 if extra < MIN_PILOT else 8)
    seen: list[tuple[FloatArray, Outcomes, IntArray]] = []
    for number, size in enumerate(pilots):
        if not proposals:
            break
        draw, which = _drawn(variables, proposals, size, vehicles, generator(number))
        seen.append((draw, simulate(draw), which))
        proposals = _better_proposals(variables, proposals, seen, outcomes, tiltable)
    left = extra - sum(len(draw) for draw, _, _ in seen)
    safe = min(left, max(0, int(np.ceil(PLAIN_SHARE * (count + left))) - count)) if proposals else left
    rng = generator(rounds)
    more = rng.random((safe, vehicles))
    draw, which = _drawn(variables, proposals, left - safe, vehicles, rng)
    draw, which = np.concatenate([more, draw]), np.concatenate([np.full(safe, -1), which])
    counts = np.bincount(which[which >= 0], minlength=len(proposals)).tolist()
    found = simulate(draw)
    draw = np.concatenate([plain, draw])
    return Sampled(
        draw=draw,
        outcomes=joined([outcomes, found]),
        weight=weights(variables, count + safe, proposals, counts, draw),
        proposal=np.concatenate([np.full(count, -1), which]),
        proposals=tuple(proposals),
        pilot=extra - left,
    )


def joined(parts: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of several sets of futures, one after the other."""
    starts = np.cumsum([0, *(part.futures for part in parts)])
    names = ("first", "second", "gap", "collided")
    return Outcomes(
        futures=int(starts[-1]),
        future=np.concatenate([part.future + start for part, start in zip(parts, starts, strict=False)]),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
    )


def _drawn(
    variables: Variables,
    proposals: Sequence[Proposal],
    count: int,
    vehicles: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, IntArray]:
    """Return futures (count, V) of proposals in turn, and the proposal (count,) of each."""
    plain = rng.random((count, vehicles))
    if not len(proposals):
        return plain, np.full(count, -1)
    shares = np.array([proposal.share for proposal in proposals])
    ends = np.rint(np.cumsum(shares) / shares.sum() * count).astype(np.int64)
    which = np.searchsorted(ends, np.arange(count), side="right")
    parts = [
        proposal.draw(variables, plain[which == number], rng) for number, proposal in enumerate(proposals)
    ]
    return np.concatenate(parts), which


def _first_proposals(
    variables: Variables, draw: FloatArray, outcomes: Outcomes, tiltable: BoolArray, most: int
) -> list[Proposal]:
    """Return proposals for the pairs that are closest to a collision in plain futures.

    If the least gap and the scores were jointly normal, futures with the gap 0 would have these means.
    """
    misses = ~outcomes.hits()
    close: list[tuple[float, tuple[int, int], FloatArray]] = []
    if misses.sum() < 3:
        return []
    for pair in outcomes.pairs():
        gap = outcomes.of(pair)[0][misses]
        spread = gap.std()
        sds = gap.mean() / spread if spread > 0 else np.inf
        if sds < _MAX_SDS and tiltable[list(pair)].any():
            close.append((sds, pair, gap))
    close.sort(key=lambda one: one[:2])
    result: list[Proposal] = []
    for sds, pair, gap in close[:most]:
        means = np.zeros((2, len(variables.prior)))
        for side, vehicle in enumerate(pair):
            if tiltable[vehicle]:
                score = variables.scores(draw[misses, vehicle])
                together = -_correlation(score, ndtri((mean_ranks(gap) - 0.5) / len(gap)))
                means[side] = _LIKELY_SDS * _shrunk(together, 1 / np.sqrt(len(gap)))
        share = np.exp(close[0][0] - sds)
        if share > _MIN_SHARE:
            result += _of_pair(variables, pair, means, tiltable, share)
    return result


def _of_pair(
    variables: Variables, pair: tuple[int, int], means: FloatArray, tiltable: BoolArray, share: float
) -> list[Proposal]:
    """Return proposals with the means (2, K) of a pair: whole, halved, and with either driver inattentive."""
    result = []
    group = np.array(variables.inattentive, dtype=np.int64)
    for scale, away, part in _VARIANTS:
        if away is not None and not (tiltable[pair[away]] and len(group)):
            continue
        mean = scale * np.clip(means, -_MAX_MEAN, _MAX_MEAN)
        if away is not None:
            best = group[np.argmax(mean[away, group])]
            mean[away, group] = 0.0
            mean[away, best] = _AWAY_MEAN
        ratio = np.stack([variables.tilted(one) for one in mean])
        result.append(Proposal(vehicles=pair, ratio=ratio, pair=pair, share=part * share))
    return result


def _better_proposals(
    variables: Variables,
    proposals: Sequence[Proposal],
    seen: Sequence[tuple[FloatArray, Outcomes, IntArray]],
    plain: Outcomes,
    tiltable: BoolArray,
) -> list[Proposal]:
    """Return proposals by cross-entropy over pilot futures: over hits, or over the closest futures."""
    draw = np.concatenate([part[0] for part in seen])
    outcomes = joined([part[1] for part in seen])
    which = np.concatenate([part[2] for part in seen])
    pairs = list(dict.fromkeys([*(p.pair for p in proposals), *outcomes.pairs(collided=True)]))
    weight = weights(
        variables, plain.futures, proposals, np.bincount(which, minlength=len(proposals)).tolist(), draw
    )
    before = {p.pair: sum(q.share for q in proposals if q.pair == p.pair) for p in proposals}
    spread = {pair: float(np.sqrt((weight[outcomes.of(pair)[1]] ** 2).sum())) for pair in pairs}
    some = sum(spread.values())
    result: list[Proposal] = []
    for pair in pairs:
        if not tiltable[list(pair)].any():
            continue
        gap, hit = outcomes.of(pair)
        share = before.get(pair, 0.0) / sum(before.values())
        if some:
            share = 0.3 * share + 0.7 * spread[pair] / some
        if hit.sum() >= MIN_HITS:
            elite, w = np.flatnonzero(hit), weight[hit]
        else:
            own = np.flatnonzero([proposals[k].pair == pair for k in which])
            if not len(own):
                continue
            elite = own[np.argsort(gap[own], kind="stable")[: max(MIN_HITS, int(_CLOSEST * len(own)))]]
            w = np.ones(len(elite))
        error = np.sqrt((w**2).sum()) / w.sum()
        means = np.zeros((2, len(variables.prior)))
        for side, vehicle in enumerate(pair):
            if tiltable[vehicle]:
                means[side] = _shrunk(w @ variables.scores(draw[elite, vehicle]) / w.sum(), error)
        result += _of_pair(variables, pair, means, tiltable, share)
    return result


def _shrunk(mean: FloatArray, error: float) -> FloatArray:
    """Return means (K,) drawn towards 0 by their standard error."""
    return np.asarray(mean * np.clip(1 - (_NOISE * error / np.maximum(np.abs(mean), 1e-9)) ** 2, 0.0, 1.0))


def _correlation(score: FloatArray, value: FloatArray) -> FloatArray:
    centred, off = score - score.mean(axis=0), value - value.mean()
    scale = score.std(axis=0) * value.std()
    together = (centred * off[:, None]).mean(axis=0)
    return np.asarray(np.where(scale > 0, together / np.where(scale > 0, scale, 1.0), 0.0))
