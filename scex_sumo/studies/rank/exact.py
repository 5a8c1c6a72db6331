"""Exact scores of a ranking: what critical pairs add to the score of a moment, from chosen futures.

Tables predict the score of every assignment. The score of a moment is the exact mean of the predictions, plus
the mean difference of the drawn futures from theirs. A right table adds no sampling error; a wrong one costs
certainty, not correctness.

Source: control variates, Hammersley and Handscomb 1964, 5.5.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.certainty.exact import MAX_FUTURES, MIN_CHECKED, why_not_exact
from scex_sumo.certainty.futures import DrawnModels, encounters_only
from scex_sumo.certainty.search import BASE_ROWS, Search
from scex_sumo.certainty.tables import union_probability
from scex_sumo.extrapolation.assignments import EXACT_STREAM, future_generator
from scex_sumo.extrapolation.job import Job, run_in_memory
from scex_sumo.statistics.bands import remainder_of
from scex_sumo.studies.moments.run import built
from scex_sumo.studies.rank.scores import CRITICAL_WEIGHT, RankSettings, critical_pairs, worth_of

COLLISION, CRITICAL = EVENTS = ("collision", "critical")

_Key: TypeAlias = tuple[int, int, str]  # two track ids, ascending, and the event


@dataclass(frozen=True, kw_only=True)
class ExactScore:
    """What tables say about the score of a moment.

    Attributes:
        mean: exact mean of the predicted scores.
        predicted: (C,) score of each future that may be drawn.
        settled: each event that the score counts has a table.
        p_collision: exact probability of any collision; None if a pair that collides has no table.
        pairs: two track ids, event, and its exact probability.
        extra: number of futures that were run for the tables.
        checked: number of drawn futures that the tables predicted.
    """

    mean: float
    predicted: Sequence[float]
    settled: bool
    p_collision: float | None
    pairs: Sequence[tuple[int, int, str, float]]
    extra: int
    checked: int

    @property
    def remainder(self) -> float:
        """Share of assignments that a table may get wrong, at most, with 95 %."""
        return remainder_of(self.checked)

    def pair(self, one: int, other: int, event: str) -> float | None:
        """Return the exact probability of an event of two vehicles; None without a table."""
        key = [min(one, other), max(one, other), event]
        return next((p for *named, p in self.pairs if named == key), None)


def search_after(settings: RankSettings, ends: Sequence[int]) -> int | None:
    """Return the number of drawn futures after which tables are searched, if they may save futures."""
    for end in ends if settings.exact else ():
        if end >= MIN_CHECKED and settings.futures - end >= BASE_ROWS:
            why = why_not_exact(settings.run, built(settings.models), end)
            return end if why is None else None
    return None


def find_exact_score(job: Job, pairs: Sequence[IntArray]) -> ExactScore:
    """Run futures with chosen assignments, and return what the tables of critical pairs say.

    Args:
        job: with the assignments of all futures that may be drawn.
        pairs: critical encounters of each drawn future, as of `pairs_of`.
    """
    drawn = DrawnModels(job)
    futures, tracks, count = _Futures(job, drawn), drawn.track_ids, len(pairs)
    levels, seen = drawn.levels, futures.events(pairs)
    open_ = known = set(seen)
    right: dict[_Key, dict[_Path, float]] = {}
    while open_ and len(futures.known) < (most := min(MAX_FUTURES, 2 * count)):
        keys = sorted(known, key=lambda key: (EVENTS.index(key[2]), key))
        search = Search(
            drawn.each,
            levels[:count],
            _happens(seen, keys, count),
            [[tracks.index(track) for track in key[:2]] for key in keys],
            rank=[EVENTS.index(key[2]) for key in keys],
            rng=future_generator(job.settings.seed, 0, EXACT_STREAM),
        )
        search.run(lambda rows, keys=keys: futures.run(rows, keys), most=most)  # type: ignore[misc]
        settled = [e for e in range(len(keys)) if search.is_settled(e)]
        predicts = {e: search.predict(e, search.drawn) == search.seen[:, e] for e in settled}
        right = {keys[e]: futures.leaves(search, e, keys[e]) for e in settled if predicts[e].all()}
        happened = futures.events(list(futures.known.values())).keys()
        if happened <= known:
            break
        known = known | happened  # events of extra futures alone
    return _score(futures, right, known - right.keys(), count)


_Path: TypeAlias = tuple[tuple[int, int], ...]  # vehicles and their levels


def _score(
    futures: _Futures,
    right: Mapping[_Key, Mapping[_Path, float]],
    open_: set[_Key],
    count: int,
) -> ExactScore:
    drawn, levels = futures.drawn, futures.drawn.levels
    predicted, mean, tables, each = np.zeros(len(levels)), 0.0, [], []
    for key, leaves in right.items():
        shares = {path: prod(float(drawn.each[v][level]) for v, level in path) for path in leaves}
        mean += sum(shares[path] * worth for path, worth in leaves.items())
        each.append((*key, sum(shares.values())))
        for path, worth in leaves.items():
            predicted += worth * np.all([levels[:, v] == level for v, level in path] or [True], axis=0)
        if key[2] == COLLISION:
            tables.append(drawn.table(leaves, {v for path in leaves for v, _ in path}, count))
    collides = any(key[2] == COLLISION for key in open_)
    return ExactScore(
        mean=mean,
        predicted=predicted.tolist(),
        settled=not open_,
        p_collision=None if collides else union_probability(tables),
        pairs=each,
        extra=len(futures.known),
        checked=count,
    )


class _Futures:
    """Futures that were run for tables.

    Attributes:
        known: critical encounters by assignment.
    """

    def __init__(self, job: Job, drawn: DrawnModels) -> None:
        self._job = dataclasses.replace(job, settings=encounters_only(job.settings))
        self.drawn = drawn
        self.known: dict[bytes, IntArray] = {}

    def run(self, rows: IntArray, keys: Sequence[_Key]) -> BoolArray:
        """Return (R, E) whether events happen in assignments of levels (R, V)."""
        asked = {row.tobytes(): row for row in rows}
        new = {code: row for code, row in asked.items() if code not in self.known}
        if new:
            job = dataclasses.replace(self._job, assignment=self.drawn.assignment(np.array([*new.values()])))
            pairs = critical_pairs(run_in_memory(job, range(len(new))), job.scene.track_ids)
            self.known |= dict(zip(new, pairs, strict=True))
        return _happens(self.events([self.known[row.tobytes()] for row in rows]), keys, len(rows))

    def leaves(self, search: Search, event: int, key: _Key) -> dict[_Path, float]:
        """Return the partial assignments under which an event happens, and what it adds on average."""
        leaves = {}
        for leaf in search.trees[event].leaves():
            if search.outcomes[leaf.rows[0], event]:
                pairs = [self.known[search.rows[row].tobytes()] for row in leaf.rows]
                leaves[leaf.path] = float(self.events(pairs)[key][:, 1].mean())
        return leaves

    def events(self, pairs: Sequence[IntArray]) -> dict[_Key, FloatArray]:
        """Return by event (C, 2): 1 in the futures in which it happens, and what it adds to their score."""
        events: dict[_Key, FloatArray] = {}
        for future, rows in enumerate(pairs):
            for row, worth in zip(rows.tolist(), worth_of(rows).tolist(), strict=True):
                for event, happens, value in ((COLLISION, row[2], worth), (CRITICAL, 1, CRITICAL_WEIGHT)):
                    if happens:
                        key = (min(row[:2]), max(row[:2]), event)
                        events.setdefault(key, np.zeros((len(pairs), 2)))[future] = 1.0, value
        return events


def _happens(events: Mapping[_Key, FloatArray], keys: Sequence[_Key], count: int) -> BoolArray:
    never = np.zeros((count, 2))
    return np.stack([events.get(key, never)[:, 0] > 0 for key in keys], axis=1)
