"""Ranks of moments by score, with intervals, and the moments that get more futures.

A round depends on whole earlier rounds only, not on workers, interruptions or the order of moments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import FloatArray, IntArray, mean_ranks
from scex_sumo.statistics.density import CONFIDENCE
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.exact import ExactScore, search_after
from scex_sumo.studies.rank.scores import RankSettings

DRAWS = 200
NEARBY_S = 3.0
"""Two moments of a recording closer than a future is long show the same situation."""
_STREAM = 4  # of the random numbers; the runs' own use 0 to 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Ranks of n moments, 1 the most critical.

    Attributes:
        rank: (n,) 1 plus the number of more critical moments.
        low: (n,) best rank of the 95 % interval.
        high: (n,) worst rank of the 95 % interval.
    """

    rank: IntArray
    low: IntArray
    high: IntArray

    def order(self) -> list[int]:
        """Return indices, best first; equals in the order given."""
        return [int(i) for i in np.argsort(self.rank, kind="stable")]


def severity_share(values: FloatArray) -> FloatArray:
    """Return shares (n,) of the other moments with smaller values (n, M), averaged over the metrics.

    Equal values count half; a single moment has 0.
    """
    count, metrics = values.shape
    if count < 2 or metrics == 0:
        return np.zeros(count)
    total = np.zeros(count)
    for column in values.T:
        total += mean_ranks(column) - 1  # without the moment itself
    return np.asarray(total / (metrics * (count - 1)), dtype=np.float64)


def place(
    score: FloatArray, error: FloatArray, *, severity: FloatArray | None = None, seed: int, draws: int = DRAWS
) -> Places:
    """Rank moments by score, then by `severity_share`, with 95 % intervals of normal errors.

    Args:
        score: (n,) mean over the futures; larger is more critical.
        error: (n,) its standard error.
        severity: (n, M) typical value of each metric; larger is more critical, -inf if undefined.

    Source: Goldstein and Spiegelhalter 1996, 5.2.
    """
    rank = _ranks(score if severity is None else _refined(score, severity_share(severity)))
    if len(score) < 2:
        return Places(rank=rank, low=rank, high=rank)
    level = (_levels(len(score), draws, seed) + 0.5) / draws
    possible = np.maximum(score[:, None] + error[:, None] * ndtri(level), 0.0)
    drawn = np.sort(np.stack([_ranks(possible[:, d]) for d in range(draws)]), axis=0)
    tail = (1 - CONFIDENCE) / 2
    low, high = drawn[int(tail * draws)], drawn[draws - 1 - int(tail * draws)]
    # Among many equals the draws spread over all their places; the rank itself is the best of them.
    return Places(rank=rank, low=np.minimum(low, rank), high=np.maximum(high, rank))


def mean_score(values: FloatArray, intervals: DesignIntervals) -> tuple[float, float]:
    """Return the mean of the scores (C,) of futures, and its standard error under their design.

    Half a future with a score that differs by 1 is added: equal futures do not prove that the next one is
    equal.
    """
    variance = float(intervals.variance(values[:, None])[0]) + (0.5 / (len(values) + 1)) ** 2
    return float(values.mean()), float(np.sqrt(variance))


def _refined(score: FloatArray, second: FloatArray) -> FloatArray:
    _, place = np.unique(np.stack([score, second], axis=-1), axis=0, return_inverse=True)
    return np.asarray(place.reshape(-1), dtype=np.float64)


def _ranks(score: FloatArray) -> IntArray:
    ordered = np.sort(score)
    return np.asarray(1 + len(score) - np.searchsorted(ordered, score, side="right"), dtype=np.int64)


def _levels(count: int, draws: int, seed: int) -> IntArray:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, _STREAM)))
    levels = np.broadcast_to(np.arange(draws, dtype=np.int64), (count, draws))
    return rng.permuted(levels, axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """Result of a moment in one round.

    Attributes:
        futures: of this round.
        score: mean of all its futures so far, corrected by the tables.
        kept: futures of this round whose tracks are kept.
        exact: what tables say, if they were searched.
    """

    futures: int
    score: float
    error: float
    kept: int = 0
    exact: ExactScore | None = None


def rounds(settings: RankSettings) -> list[range]:
    """Return the futures of each round: their number doubles each time; none where tables are searched."""
    if not settings.first:
        return [range(settings.futures)]
    ends = [settings.first]
    while ends[-1] < settings.futures:
        ends.append(min(2 * ends[-1], settings.futures))
    spans, searched = list(map(range, [0, *ends], ends)), search_after(settings, ends)
    return spans if searched is None else sorted([*spans, range(searched, searched)], key=lambda s: s.stop)


def current_places(refs: Sequence[MomentRef], tallies: Mapping[str, Sequence[Tally]], *, seed: int) -> Places:
    """Rank moments by all their rounds."""
    last = [tallies[ref.moment][-1] for ref in refs]
    score, error = np.array([tally.score for tally in last]), np.array([tally.error for tally in last])
    return place(score, error, seed=seed)


def undecided(
    refs: Sequence[MomentRef], tallies: Mapping[str, Sequence[Tally]], number: int, *, top: int, seed: int
) -> list[MomentRef]:
    """Return the moments of the round before that may reach the page and whose rank is uncertain.

    An exact score stays as it is.

    Args:
        refs: moments without failure, in the order of the dataset.
        tallies: rounds by moment; those from ``number`` on are ignored.
        number: of the round to come, from 1.
    """
    before = {ref.moment: list(tallies[ref.moment])[:number] for ref in refs if tallies.get(ref.moment)}
    known = [ref for ref in refs if ref.moment in before]
    if not known:
        return []
    places = current_places(known, before, seed=seed)
    shown = distinct_moments(known, places.order(), top)
    last = max((int(places.rank[i]) for i in shown), default=0)
    last_of = [before[ref.moment][-1].exact for ref in known]
    possible = [
        len(before[ref.moment]) == number and not (exact and exact.settled)
        for ref, exact in zip(known, last_of, strict=True)
    ]
    uncertain = (places.low <= last) & (places.low < places.high) & possible
    return [known[i] for i in np.flatnonzero(uncertain)]


def distinct_moments(refs: Sequence[MomentRef], order: Sequence[int], top: int) -> list[int]:
    """Return the ``top`` moments that show different situations, as indices, best first.

    Args:
        order: indices of the moments, best first.
    """
    chosen: list[int] = []
    for i in order:
        if not any(nearby(refs[i], refs[j]) for j in chosen):
            chosen.append(i)
        if len(chosen) == top:
            break
    return chosen


def nearby(one: MomentRef, other: MomentRef) -> bool:
    """Whether two moments show the same situation."""
    if one.recording != other.recording or one.case or other.case:
        return one.moment == other.moment
    return abs(one.time_s - other.time_s) < NEARBY_S
