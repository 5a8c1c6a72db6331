"""Places of moments by score, how sure they are, and which moments get more children for that.

A round ends when all its moments are through, and the next is decided from whole rounds only: what is run
depends on neither workers nor interruptions nor the order in which moments finish.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.ranking.moments import MomentRef
from scex_sumo.statistics.density import CONFIDENCE
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.statistics.normal import normal_quantiles

DRAWS = 200
NEARBY_S = 3.0
"""Two moments of a recording closer than a child is long show the same situation."""
_STREAM = 4  # of the random numbers; the runs' own use 0 to 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Places of n moments, 1 the most critical.

    Attributes:
        score: (n,) mean over the children, see `scex_sumo.ranking.run_moment.score_of`.
        rank: (n,) 1 plus the number of moments with a greater score, or an equal one and more severe.
        low: (n,) best rank of the 95 % interval.
        high: (n,) worst rank of it.
    """

    score: FloatArray
    rank: IntArray
    low: IntArray
    high: IntArray

    def order(self) -> list[int]:
        """Indices, best first; equals in the order given."""
        return [int(i) for i in np.argsort(self.rank, kind="stable")]


def beaten(values: FloatArray) -> FloatArray:
    """How many of the other moments have smaller values, averaged over the metrics; equal ones count half.

    Args:
        values: (n, M) of any units, NaN-free.

    Returns:
        (n,) 0 to 1; 0 for a single moment.
    """
    count, metrics = values.shape
    if count < 2 or metrics == 0:
        return np.zeros(count)
    total = np.zeros(count)
    for column in values.T:
        ordered = np.sort(column)
        below = np.searchsorted(ordered, column, side="left")
        not_above = np.searchsorted(ordered, column, side="right")
        total += (below + not_above - 1) / 2  # without the moment itself
    return np.asarray(total / (metrics * (count - 1)), dtype=np.float64)


def place(
    score: FloatArray,
    error: FloatArray,
    *,
    severity: FloatArray | None = None,
    seed: int,
    draws: int = DRAWS,
) -> Places:
    """Ranks by score, with intervals.

    Moments of equal score, as where no child of either has a critical encounter, are ranked by how many
    others they beat in severity.

    Each score is drawn from the normal distribution of its standard error, cut at 0, ``draws`` times; the
    interval of a rank is that of the middle 95 % of the draws.

    Args:
        score: (n,) mean over the children, the larger the more critical.
        error: (n,) its standard error.
        severity: (n, M) typical value of each metric, the larger the more critical; -inf where undefined.
        seed: of the draws.
        draws: how many.

    Source of the interval of ranks: Goldstein and Spiegelhalter 1996, 5.2.
    """
    rank = _ranks(score if severity is None else _refined(score, beaten(severity)))
    if len(score) < 2:
        return Places(score=score, rank=rank, low=rank, high=rank)
    level = (_levels(len(score), draws, seed) + 0.5) / draws
    possible = np.maximum(score[:, None] + error[:, None] * normal_quantiles(level), 0.0)
    drawn = np.sort(np.stack([_ranks(possible[:, d]) for d in range(draws)]), axis=0)
    tail = (1 - CONFIDENCE) / 2
    low, high = drawn[int(tail * draws)], drawn[draws - 1 - int(tail * draws)]
    # Among many equals the draws spread over all their places; the rank itself is the best of them.
    return Places(score=score, rank=rank, low=np.minimum(low, rank), high=np.maximum(high, rank))


def mean_score(values: FloatArray, intervals: DesignIntervals) -> tuple[float, float]:
    """Mean of the children's scores and its standard error, as their design leaves it.

    Children that are all alike do not prove that the next would be, too: half a child of another score is
    reckoned with.

    Args:
        values: (C,) score of each child.
        intervals: of the children.
    """
    variance = float(intervals.variance(values[:, None])[0]) + (0.5 / (len(values) + 1)) ** 2
    return float(values.mean()), float(np.sqrt(variance))


def _refined(score: FloatArray, second: FloatArray) -> FloatArray:
    """A score that orders by the first, and equal ones by the second."""
    _, place = np.unique(np.stack([score, second], axis=-1), axis=0, return_inverse=True)
    return np.asarray(place.reshape(-1), dtype=np.float64)


def _ranks(score: FloatArray) -> IntArray:
    ordered = np.sort(score)
    return np.asarray(1 + len(score) - np.searchsorted(ordered, score, side="right"), dtype=np.int64)


def _levels(count: int, draws: int, seed: int) -> IntArray:
    """(count, draws) for each moment every level of 0 to draws - 1 once, in an order of its own."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, _STREAM)))
    levels = np.broadcast_to(np.arange(draws, dtype=np.int64), (count, draws))
    return rng.permuted(levels, axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """What a round found of a moment.

    Attributes:
        children: how many ran.
        score: of all its children, up to this round, see `mean_score`.
        error: standard error of it.
        kept: how many of this round's have their tracks kept.
    """

    children: int
    score: float
    error: float
    kept: int = 0


def round_ends(children: int, first: int) -> list[int]:
    """Children that a moment has after each round: doubled each time, up to ``children``."""
    ends = [min(first, children)]
    while ends[-1] < children:
        ends.append(min(2 * ends[-1], children))
    return ends


def standing(refs: Sequence[MomentRef], tallies: Mapping[str, Sequence[Tally]], *, seed: int) -> Places:
    """The places of moments by all their rounds."""
    last = [tallies[ref.moment][-1] for ref in refs]
    score, error = np.array([tally.score for tally in last]), np.array([tally.error for tally in last])
    return place(score, error, seed=seed)


def undecided(
    refs: Sequence[MomentRef], tallies: Mapping[str, Sequence[Tally]], number: int, *, top: int, seed: int
) -> list[MomentRef]:
    """Moments that get more children in a round.

    Those that had children in the round before, may be among the moments on the page, and whose place is
    not certain.

    Args:
        refs: all moments that have not failed, in the order of the dataset.
        tallies: by moment, its rounds so far; later ones than ``number`` are not looked at.
        number: of the round to come, from 1.
        top: moments on the page.
        seed: of the draws.
    """
    before = {ref.moment: list(tallies[ref.moment])[:number] for ref in refs if tallies.get(ref.moment)}
    known = [ref for ref in refs if ref.moment in before]
    if not known:
        return []
    places = standing(known, before, seed=seed)
    shown = distinct_moments(known, places.order(), top)
    last = max((int(places.rank[i]) for i in shown), default=0)
    return [
        ref
        for i, ref in enumerate(known)
        if len(before[ref.moment]) == number and places.low[i] <= last and places.low[i] < places.high[i]
    ]


def distinct_moments(refs: Sequence[MomentRef], order: Sequence[int], top: int) -> list[int]:
    """The best moments that show different situations, as indices, best first.

    Of moments of one recording less than `NEARBY_S` apart only the best counts; cases are all different.

    Args:
        refs: the moments.
        order: indices, best first.
        top: how many.
    """
    chosen: list[int] = []
    for i in order:
        if not any(nearby(refs[i], refs[j]) for j in chosen):
            chosen.append(i)
        if len(chosen) == top:
            break
    return chosen


def nearby(one: MomentRef, other: MomentRef) -> bool:
    """Whether two moments show the same situation, or are the same."""
    if one.recording != other.recording or one.case or other.case:
        return one.moment == other.moment
    return abs(one.time_s - other.time_s) < NEARBY_S
