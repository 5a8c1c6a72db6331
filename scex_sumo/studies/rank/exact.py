"""Exact tables of a ranking: what the critical pairs of a moment add to its score, from chosen futures.

Tables predict the score of every assignment. The score of a moment is the exact mean of the predictions, plus
the mean difference of the drawn futures from theirs. A right table adds no sampling error; a wrong one costs
certainty, not correctness.

Source: control variates, Hammersley and Handscomb 1964, 5.5.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Final, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.exact.search import BASE_ROWS, Search
from scex_sumo.exact.tables import InfluenceTable, remainder_of, union_probability
from scex_sumo.extrapolation.assignments import EXACT_STREAM, child_generator
from scex_sumo.extrapolation.exact_futures import MAX_FUTURES, MIN_CHECKED, why_not_exact
from scex_sumo.extrapolation.job import Job, parts_in_memory
from scex_sumo.studies.moments.settings import built
from scex_sumo.studies.rank.scores import RankSettings, critical_pairs, worth_of

COLLISION, CRITICAL = _EVENTS = ("collision", "critical")
_NEEDED: Final = {"severity": (COLLISION,), "collisions": (COLLISION,), "encounters": (CRITICAL,)}
"""Events that the score of an order counts; that of ``mixed`` counts both."""

_Key: TypeAlias = tuple[int, int, str]  # two track ids, ascending, and the event


def exact_round(settings: RankSettings, ends: Sequence[int]) -> int | None:
    """Return the number of drawn futures after which tables are searched; None if never.

    Their futures must be fewer than those that a moment may still draw.
    """
    for end in ends if settings.exact else ():
        if end >= MIN_CHECKED and settings.children - end >= BASE_ROWS:
            why = why_not_exact(settings.run, built(settings.models), end)
            return end if why is None else None
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class WorthTable:
    """Outcome of an event of two vehicles for every assignment of its influence set, and what it adds.

    Attributes:
        worth: (M, ..., M) mean addition to the score of a future; 0 where the event does not happen.
    """

    key: _Key
    table: InfluenceTable
    worth: FloatArray

    def mean(self) -> float:
        """Return the exact mean addition over all assignments."""
        return float(reduce(lambda rest, _: rest @ self.table.shares, self.table.track_ids, self.worth))

    def of(self, levels: Mapping[int, IntArray]) -> FloatArray:
        """Return the addition (C,) in assignments: the level (C,) of each vehicle."""
        return np.asarray(self.worth[tuple(levels[track] for track in self.table.track_ids)])


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactTables:
    """Exact tables of a moment.

    Attributes:
        tables: of the events that they predict in all drawn futures.
        open: other events that happened.
        extra: number of futures that were run for the tables.
        checked: number of drawn futures that checked them.
    """

    tables: tuple[WorthTable, ...]
    open: frozenset[_Key]
    extra: int
    checked: int

    @property
    def remainder(self) -> float:
        """Share of assignments that a table may get wrong, at most, with 95 % (rule of three)."""
        return remainder_of(self.checked)

    def is_exact(self, by: str) -> bool:
        """Whether the tables of all events that an order counts are there."""
        return not any(key[2] in _NEEDED.get(by, _EVENTS) for key in self.open)

    def p_collision(self) -> float | None:
        """Return the exact probability of any collision; None if a pair that collides has no table."""
        if not self.is_exact("collisions"):
            return None
        return union_probability([one.table for one in self.tables if one.key[2] == COLLISION])

    def pair(self, one: int, other: int, event: str) -> float | None:
        """Return the exact probability of an event of two vehicles; None without a table."""
        key = (min(one, other), max(one, other), event)
        return next((each.table.probability() for each in self.tables if each.key == key), None)

    def corrected(
        self, score: FloatArray, track_ids: Sequence[int], models: Sequence[Sequence[str]]
    ) -> tuple[float, FloatArray]:
        """Return the exact mean of the predicted scores, and what each drawn future adds to its own.

        Args:
            score: (C,) of the drawn futures.
            models: (C, V) of their vehicles.
        """
        rest, whole = score.copy(), 0.0
        if self.tables:
            names = {name: level for level, name in enumerate(self.tables[0].table.models)}
            drawn = np.array([[names[model] for model in row] for row in models], dtype=np.int64)
            levels = dict(zip(track_ids, drawn.T, strict=True))
            for one in self.tables:
                whole += one.mean()
                rest -= one.of(levels)
        return whole, rest

    def to_json(self) -> dict[str, Any]:
        """Return the content of a file; the reverse of `from_json`."""
        return {
            "extra": self.extra,
            "checked": self.checked,
            "open": sorted(map(list, self.open)),
            "tables": [
                {
                    "key": list(one.key),
                    "vehicles": list(one.table.track_ids),
                    "models": list(one.table.models),
                    "shares": one.table.shares.tolist(),
                    "outcomes": one.table.outcomes.tolist(),
                    "worth": one.worth.tolist(),
                }
                for one in self.tables
            ],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> ExactTables:
        """Return the tables of `to_json`."""
        tables = tuple(
            _worth_table(
                key=_key(row["key"]),
                vehicles=[int(track) for track in row["vehicles"]],
                models=row["models"],
                shares=np.array(row["shares"], dtype=np.float64),
                outcomes=np.array(row["outcomes"], dtype=np.bool_),
                worth=np.array(row["worth"], dtype=np.float64),
                checked=int(content["checked"]),
            )
            for row in content["tables"]
        )
        kept = {name: int(content[name]) for name in ("extra", "checked")}
        return cls(tables=tables, open=frozenset(map(_key, content["open"])), **kept)


def _key(row: Sequence[Any]) -> _Key:
    one, other, event = row
    return int(one), int(other), str(event)


def _worth_table(
    *,
    key: _Key,
    vehicles: Sequence[int],
    models: Sequence[str],
    shares: FloatArray,
    outcomes: BoolArray,
    worth: FloatArray,
    checked: int,
) -> WorthTable:
    table = InfluenceTable(
        track_ids=tuple(vehicles), models=tuple(models), outcomes=outcomes, shares=shares, checked=checked
    )
    return WorthTable(key=key, table=table, worth=worth)


def find_tables(job: Job, pairs: Sequence[IntArray], by: str) -> ExactTables:
    """Run futures with chosen assignments, and return the tables of the events of critical pairs.

    Args:
        job: with the drawn assignments.
        pairs: critical encounters of each drawn future, as of `pairs_of`.
        by: order of the ranking: its events are searched first.
    """
    futures, tracks = _Futures(job, by), job.scene.track_ids.tolist()
    count, drawn = len(pairs), np.searchsorted(futures.index, job.assignment)
    seen, most = _events(pairs, by), min(MAX_FUTURES, 2 * count)
    known, more, right = set(seen), set[_Key](), list[int]()
    if not known:
        return ExactTables(tables=(), open=frozenset(), extra=0, checked=count)
    rank = {event: number for number, event in enumerate(_wanted(by))}
    while True:
        keys = sorted(known, key=lambda key: (rank[key[2]], key))
        search = Search(
            [futures.shares] * len(tracks),
            drawn,
            np.stack([_happens(seen, key, count) for key in keys], axis=1),
            [[tracks.index(track) for track in key[:2]] for key in keys],
            rank=[rank[key[2]] for key in keys],
            rng=child_generator(job.settings.seed, 0, EXACT_STREAM),
        )
        search.run(lambda rows, keys=keys: futures.run(rows, keys), most=most)  # type: ignore[misc]
        more = _events([*futures.known.values()], by).keys() - known
        if not more or len(futures.known) >= most:
            break
        known |= more
    for e in filter(search.is_settled, range(len(keys))):
        if (search.predict(e, drawn) == search.seen[:, e]).all():
            right.append(e)
    tables = tuple(futures.table(search, e, keys[e], tracks, count) for e in right)
    left = {key for e, key in enumerate(keys) if e not in right} | more
    return ExactTables(tables=tables, open=frozenset(left), extra=len(futures.known), checked=count)


class _Futures:
    """Futures that were run for tables.

    Attributes:
        index: models that vehicles draw, with ``shares``.
        known: critical encounters by assignment.
    """

    def __init__(self, job: Job, by: str) -> None:
        run, drawn = job.settings, job.models.drawn
        settings = dataclasses.replace(run, metrics=("gap",), keep_plans=False, thresholds={}, world="plain")
        self._job, self._by = dataclasses.replace(job, settings=settings), by
        self.index = np.array([k for k, spec in enumerate(drawn) if spec.weight > 0], dtype=np.int64)
        weight = np.array([drawn[k].weight for k in self.index], dtype=np.float64)
        self.shares, self.models = weight / weight.sum(), tuple(str(drawn[k]) for k in self.index)
        self.known: dict[bytes, IntArray] = {}

    def run(self, rows: IntArray, keys: Sequence[_Key]) -> BoolArray:
        """Return (R, E) whether events happen in assignments of levels (R, V)."""
        new = [
            row for row in {row.tobytes(): row for row in rows}.values() if row.tobytes() not in self.known
        ]
        if new:
            job = dataclasses.replace(self._job, assignment=self.index[np.array(new)])
            parts = parts_in_memory(job, range(len(new)))
            found = [pairs for part in parts for pairs in critical_pairs(part, job.scene.track_ids)]
            self.known |= {row.tobytes(): pairs for row, pairs in zip(new, found, strict=True)}
        happened = _events([self.known[row.tobytes()] for row in rows], self._by)
        return np.stack([_happens(happened, key, len(rows)) for key in keys], axis=1)

    def table(self, search: Search, event: int, key: _Key, tracks: Sequence[int], count: int) -> WorthTable:
        """Return the table of a settled event; what it adds is the mean over the futures of a leaf."""
        vehicles = sorted(search.influence(event), key=lambda v: tracks[v])
        outcomes = np.zeros((len(self.models),) * len(vehicles), dtype=np.bool_)
        worth = np.zeros(outcomes.shape)
        for leaf in search.trees[event].leaves():
            if search.outcomes[leaf.rows[0], event]:
                given = dict(leaf.path)
                cell = tuple(given.get(v, slice(None)) for v in vehicles)
                pairs = [self.known[search.rows[row].tobytes()] for row in leaf.rows]
                outcomes[cell], worth[cell] = True, _events(pairs, self._by)[key][:, 1].mean()
        return _worth_table(
            key=key,
            vehicles=[tracks[v] for v in vehicles],
            models=self.models,
            shares=self.shares,
            outcomes=outcomes,
            worth=worth,
            checked=count,
        )


def _events(pairs: Sequence[IntArray], by: str) -> dict[_Key, FloatArray]:
    """Return by event (C, 2): 1 in the futures in which it happens, and what it adds to their score."""
    found: dict[_Key, FloatArray] = {}
    for child, rows in enumerate(pairs):
        hit, unit, each = worth_of(rows, by)
        for row, worth in zip(rows.tolist(), (hit / unit).tolist(), strict=True):
            for event, happens, value in ((COLLISION, row[2], worth), (CRITICAL, 1, each)):
                if happens and event in _wanted(by):
                    key = (min(row[:2]), max(row[:2]), event)
                    found.setdefault(key, np.zeros((len(pairs), 2)))[child] = 1.0, value
    return found


def _wanted(by: str) -> tuple[str, ...]:
    """Return the events of an order, those that its score counts first."""
    return tuple(dict.fromkeys((*_NEEDED.get(by, _EVENTS), COLLISION)))


def _happens(events: Mapping[_Key, FloatArray], key: _Key, count: int) -> BoolArray:
    return events[key][:, 0] > 0 if key in events else np.zeros(count, dtype=np.bool_)
