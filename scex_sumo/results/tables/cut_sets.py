"""Cut sets of a pair: the smallest sets of vehicles and models with which its event always happened.

They are counted in the drawn futures. A set that holds in n of n futures may fail in up to 3/n of others.

Source: minimal cut sets as in fault trees (Vesely et al. 1981); rule of three (Hanley, Lippman-Hand 1983).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.results.tables.pairs import ends

LEAST_FUTURES: Final = 8
"""Futures of a set, at least."""
LUCK: Final = 0.05
"""Expected number of chance finds above which vehicles beside the pair are left out of a set.

Hundreds of models of other vehicles are tried: without this limit nearly all larger sets are chance.
"""
CUT_SETS: Final = pa.list_(
    pa.struct(
        [("futures", pa.int64()), ("track_ids", pa.list_(pa.int64())), ("models", pa.list_(pa.string()))]
    )
)
_COUNTS = (("futures", pa.int64()), ("happened", pa.int64()), ("lift", pa.float64()))
LIFTS: Final = pa.list_(pa.struct([("track_id", pa.int64()), ("model", pa.string()), *_COUNTS]))

WORDS: Final[Mapping[str, str]] = {
    "constant_velocity": "keeps its speed",
    "emergency_brake": "brakes hard",
    "standard_driver": "drives calmly",
    "risky_driver": "drives riskily",
    "replay": "drives as recorded",
    "runs_red": "runs red",
    "ignores_priority": "ignores priority",
    "cuts_in": "cuts in",
    "drifts": "drifts out of its lane",
    "steps_out": "steps out",
    "stops": "stops",
    "keeps_way": "keeps its way",
}
"""What a vehicle or person does under a model."""

_Set: TypeAlias = frozenset[tuple[int, int]]  # vehicles and models, as indices


@dataclass(frozen=True, eq=False)
class DrawnModels:
    """Models of the vehicles in the drawn futures.

    Attributes:
        track_ids: (V,).
        models: (C, V) names.
    """

    track_ids: IntArray
    models: NDArray[np.str_]

    @cached_property
    def _names(self) -> list[str]:
        return [str(name) for name in np.unique(self.models)]

    @cached_property
    def _has(self) -> NDArray[np.float32]:
        """(C, V, M) 1 where a vehicle has a model."""
        return np.asarray(self.models[:, :, None] == np.array(self._names), dtype=np.float32)

    def cut_sets(self, pair: tuple[int, int], happens: BoolArray) -> list[dict[str, Any]]:
        """Return the smallest sets with which an event always happened, the most frequent first.

        A set has at most two vehicles beside the pair, and `LEAST_FUTURES` or more futures.

        Args:
            pair: index of each of its vehicles.
            happens: (C,) whether the event happens in each future.

        Returns:
            Rows of `CUT_SETS`; a set without vehicles: the event happens in all futures.
        """
        counts: dict[_Set, int] = {}
        vehicles, count = self._has.shape[1], len(self._names)
        others = np.delete(np.arange(vehicles), pair)
        beside = self._has[:, others].reshape(len(happens), -1)
        choices = [[(v, m) for m in range(count)] for v in pair]
        for own in [(), *product(chain(*choices)), *product(*choices)]:
            base: _Set = frozenset(own)
            rows = np.all([np.ones_like(happens), *(self._has[:, v, m] > 0 for v, m in own)], axis=0)
            if happens[rows].sum() < LEAST_FUTURES or any(smaller <= base for smaller in counts):
                continue
            if happens[rows].all():
                counts[base] = int(rows.sum())
                continue
            for columns, futures in _always(beside[rows], happens[rows]):
                whole = base | {(int(others[c // count]), c % count) for c in columns}
                if not any(smaller <= whole for smaller in counts):
                    counts[whole] = futures
        order = sorted(counts, key=lambda members: (-counts[members], len(members), sorted(members)))
        return [self._row(sorted(members), counts[members]) for members in order]

    def _row(self, members: Sequence[tuple[int, int]], futures: int) -> dict[str, Any]:
        ids, models = [int(self.track_ids[v]) for v, _ in members], [self._names[m] for _, m in members]
        return {"futures": futures, "track_ids": ids, "models": models}

    def lifts(self, pair: tuple[int, int], happens: BoolArray) -> list[dict[str, Any]]:
        """Return how much likelier an event is with each model of a pair's vehicles: rows of `LIFTS`.

        ``lift`` is P(event | the vehicle has the model) / P(event).
        """
        rows = []
        for v, (m, name) in product(pair, enumerate(self._names)):
            has = self._has[:, v, m] > 0
            futures, happened = int(has.sum()), int(happens[has].sum())
            if 0 < futures < len(has):  # a vehicle with one model tells nothing
                counts = {"futures": futures, "happened": happened}
                lift = happened / futures / float(happens.mean())
                rows.append({"track_id": int(self.track_ids[v]), "model": name, **counts, "lift": lift})
        return rows


def _always(has: NDArray[np.float32], happens: BoolArray) -> Iterator[tuple[tuple[int, ...], int]]:
    """Yield one or two models of other vehicles with which an event always happens, and their futures.

    Args:
        has: (C, L) 1 where a vehicle has a model, for all L.
        happens: (C,).
    """
    frequent = np.flatnonzero(has[happens].sum(axis=0) >= LEAST_FUTURES)
    drives = has[:, frequent]
    hits, misses = (drives[rows].T @ drives[rows] for rows in (happens, ~happens))
    alone = np.diag(hits) / np.diag(hits + misses)
    before = np.maximum(np.maximum.outer(alone, alone), happens.mean())  # share with one model less
    np.fill_diagonal(before, happens.mean())
    sure = (misses == 0) & (hits >= LEAST_FUTURES) & (has.shape[1] * before**hits < LUCK)
    first, second = np.nonzero(np.triu(sure))
    for k in np.argsort(first != second, kind="stable").tolist():
        yield tuple({int(frequent[first[k]]), int(frequent[second[k]])}), int(hits[first[k], second[k]])


def cut_set_words(row: Mapping[str, Any]) -> list[str]:
    """Return the cut sets of a row of encounters in words.

    E.g. ``in 24 of 24 futures in which 15 brakes hard and 16 keeps its speed``.

    Sets that differ in the model of one vehicle are one phrase.
    """
    sentences: list[tuple[int, dict[int, list[str]]]] = []
    names = dict(zip((row["track_id"], row["other_id"]), ends(row), strict=True))
    for cut_set in row["cut_sets"] or ():
        own = {track: [model] for track, model in zip(cut_set["track_ids"], cut_set["models"], strict=True)}
        for k, (futures, models) in enumerate(sentences):
            differ = [track for track in own if own[track] != models.get(track)]
            if own.keys() == models.keys() and len(differ) == 1:
                joined = models | {differ[0]: models[differ[0]] + own[differ[0]]}
                sentences[k] = futures + cut_set["futures"], joined
                break
        else:
            sentences.append((cut_set["futures"], own))
    sentences.sort(key=lambda sentence: -sentence[0])
    return [
        _phrase(futures, {names.get(track, str(track)): drawn for track, drawn in models.items()})
        for futures, models in sentences
    ]


def _phrase(futures: int, models: Mapping[str, Sequence[str]]) -> str:
    parts = [f"{track} {_any_of(names)}" for track, names in models.items()]
    return f"in {futures} of {futures} futures in which {' and '.join(parts)}" if parts else "in all futures"


def _any_of(models: Sequence[str]) -> str:
    words = [WORDS.get(model, f"drives as {model}") for model in models]
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
