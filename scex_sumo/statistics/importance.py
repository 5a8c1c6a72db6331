"""Importance sampling of rare events: outcomes of futures, weights, an interval of few weighted hits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaincinv

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.density import CONFIDENCE, Interval


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
    drawn, chance, _ = drawn_by_size(share, count, rng)
    return drawn, 1 / chance / (1 / chance).sum()


def drawn_by_size(
    size: FloatArray, count: int, rng: np.random.Generator
) -> tuple[IntArray, FloatArray, float]:
    """Draw candidates, ascending, with chances min(1, factor x size); return both and the factor."""
    if not count:
        return np.empty(0, dtype=np.int64), np.empty(0), 0.0
    certain, factor = np.zeros(len(size), dtype=np.bool_), np.inf
    while not certain.all():
        factor = (count - certain.sum()) / max(float(size[~certain].sum()), 1e-300)
        above = ~certain & (size * factor >= 1)
        if not above.any():
            break
        certain |= above
    chance = np.where(certain, 1.0, np.minimum(size * min(factor, 1e300), 1.0))
    order = np.lexsort((rng.random(len(size)), size))  # so that weights add up almost the same in each draw
    ends = np.cumsum(chance[order])
    at = np.searchsorted(ends, (rng.random() + np.arange(count)) * ends[-1] / count, side="right")
    drawn = np.sort(order[np.minimum(at, len(size) - 1)])
    return drawn, chance[drawn], float(factor)


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


def joined(parts: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of several sets of futures, one after the other."""
    starts = np.cumsum([0, *(part.futures for part in parts)])
    names = ("first", "second", "gap", "collided")
    return Outcomes(
        futures=int(starts[-1]),
        future=np.concatenate([part.future + start for part, start in zip(parts, starts, strict=False)]),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Futures that estimate a rare event, drawn plainly or chosen.

    Attributes:
        draw: (N, V).
        weight: (N,) of futures with a collision by the balance heuristic; 0 for all others.
        chosen: (N,) index into ``pairs``, for which a future was chosen; -1 for plain futures.
        chance: (N,) with which a future was chosen from the simulations; 0 for plain futures.
        spreads: (K,) relative variance of the simulations that choose futures, by pair.
        next_weight: largest weight of another collision that simulations foretell.
        simulated: number of simulations of pairs.
    """

    draw: FloatArray
    outcomes: Outcomes
    weight: FloatArray
    chosen: IntArray
    pairs: tuple[tuple[int, int], ...]
    chance: FloatArray
    spreads: FloatArray
    next_weight: float
    simulated: int

    def hits(self, pair: tuple[int, int] | None = None) -> BoolArray:
        """Return (N,) whether a future counts as one in which a pair, or any, collides."""
        hit = self.outcomes.hits() if pair is None else self.outcomes.of(pair)[1]
        return hit & (self.weight > 0)

    def probability(self, pair: tuple[int, int] | None = None) -> Interval:
        """Return the probability that a pair, or any, collides, with a 95 % interval.

        The next hit may have the weight of a simulation that nearly collides, unless hits are many and their
        weights alike: then the largest one of a hit. Without a hit it may be one that nothing foretells: a
        plain future.
        """
        hit = self.hits(pair)
        hits = self.weight[hit]
        many = len(hits) >= SURE_HITS and hits.sum() ** 2 >= SURE_EFFECTIVE * (hits**2).sum()
        largest = 1 / float((self.chosen < 0).sum())
        if len(hits):
            largest = float(hits.max() if many else max(hits.max(), self.next_weight))
        return weighted_interval(hits, largest, len(hit), variance=self._variance(hit))

    def _variance(self, hit: BoolArray) -> float:
        """Return the variance of the sum of weights: of the choice of futures, and of the simulations."""
        squares = self.weight[hit] ** 2
        result = float(squares @ (1 - self.chance[hit]))
        for k, spread in enumerate(self.spreads.tolist()):
            result += spread * float(self.weight[hit & (self.chosen == k)].sum()) ** 2
        return max(result, float(squares.sum())) * (1 + _FEW / max(len(squares), 1))


PLAIN_SHARE: Final = 0.2
"""Least share of candidates that are drawn whatever their score."""

SURE_HITS: Final = 20
SURE_EFFECTIVE: Final = 10.0
"""Hits, and their effective number (Σw)² / Σw², from which their weights bound that of the next hit."""

_FEW = 2.0  # hits, by which a variance estimated from few of them is too small
