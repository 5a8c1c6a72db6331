"""Exact probabilities of a run: few futures with chosen assignments, and tables made from them.

The drawn futures stay as they are: they say where to look, and check the tables.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.behaviors.base import is_driven_by_sumo, sight_of
from scex_sumo.certainty.futures import DrawnModels, ExtraFutures
from scex_sumo.certainty.results import Exact
from scex_sumo.certainty.search import MAX_VEHICLES, Search
from scex_sumo.certainty.tables import InfluenceTable, reduced
from scex_sumo.extrapolation.assignments import EXACT_STREAM, future_generator
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.folder import assignments_table
from scex_sumo.results.parts import PARTS
from scex_sumo.results.tables.encounters import answers_of
from scex_sumo.results.tables.outcomes import encounters_of_rows

MAX_FUTURES: Final = 385
"""Futures that are run for the tables, at most, and no more than twice those that the run draws."""

MIN_CHECKED: Final = 60
"""Drawn futures below which nothing is said: they leave more than 5 % unchecked."""

FRESH: Final = 96
"""Futures drawn anew to check tables that learned from a drawn future."""

SECOND: Final = 150
"""Futures left for tables that a drawn future contradicts: to learn from it, and for the new check."""

FOLDER: Final = "exact"
"""Folder of the extra futures, in that of the run."""

_Key = tuple[int, int, str]


def why_not_exact(settings: RunSettings, models: ModelSet, futures: int) -> str | None:
    """Return why a run has no exact probabilities; None if it has."""
    for name, model in zip(models.names, models.built, strict=True):
        if sight_of(model) is None:
            return f"{name} draws at random or is not known to be deterministic"
        if is_driven_by_sumo(model):
            return f"{name} is driven by SUMO, and may draw at random"
    if settings.count is None:
        return "all assignments were run"
    if futures < MIN_CHECKED:
        return f"{futures} futures are too few to check tables; at least {MIN_CHECKED} are"
    if len({tuple(weights.items()) for weights in models.people.values() if len(weights) > 1}) > 1:
        return "pedestrians and cyclists draw different models"
    if sum(spec.weight > 0 for spec in models.drawn) < 2:
        return "there is only one model to draw"
    return None


def find_exact(job: Job, drawn: pa.Table, workers: Workers) -> Exact:
    """Run extra futures, and return the influence tables of all pairs that are critical in some future.

    Args:
        job: of the finished run.
        drawn: encounters of its futures, as `encounter_rows`.
    """
    drawn_models = DrawnModels(job)
    futures = _Futures(job, drawn_models, workers)
    seen = futures.answers(drawn, 0, len(job.assignment))
    most = min(MAX_FUTURES, 2 * len(job.assignment))
    known: set[_Key] = set(seen)
    while True:
        keys = sorted(known, key=lambda key: (list(EVENTS).index(key[2]), key))
        search = _searched(drawn_models, futures, seen, keys, most)
        new = {key for key in futures.happened if key[2] == COLLISION} - known
        if not new or futures.count >= most:
            break
        known |= new  # pairs that collide in extra futures alone
    tables, sampled = _believed(drawn_models, futures, search, seen, keys, most)
    sampled |= {key: "collides in futures run for other pairs only" for key in new}
    futures.keep()
    return Exact(
        draws=drawn_models.draws,
        tables=tables,
        sampled=sampled,
        checked=len(job.assignment),
        extra=futures.count,
    )


class _Futures:
    """Extra futures of chosen assignments, and what happens in them."""

    def __init__(self, job: Job, drawn: DrawnModels, workers: Workers) -> None:
        self._extra, self._drawn = ExtraFutures(job, job.folder / FOLDER, workers), drawn
        self._start, self.seed = len(job.assignment), job.settings.seed
        self._levels = np.empty((0, job.scene.vehicles), dtype=np.int64)
        self.happened: set[_Key] = set()
        self._answers: dict[_Key, BoolArray] = {}

    @property
    def count(self) -> int:
        """Number of futures that were run."""
        return len(self._levels)

    def run(self, levels: IntArray, keys: Sequence[_Key]) -> BoolArray:
        """Return (R, E) whether events happen in assignments of levels (R, V); known ones are not run."""
        places = {row.tobytes(): number for number, row in enumerate(self._levels)}
        new: list[IntArray] = []
        for row in levels:
            if row.tobytes() not in places:
                places[row.tobytes()] = self.count + len(new)
                new.append(row)
        if new:
            self._run(np.array(new))
        at = [places[row.tobytes()] for row in levels]
        never = np.zeros(self.count, dtype=np.bool_)
        return np.stack([self._answers.get(key, never)[at] for key in keys] or [never[at]], axis=1)[
            :, : len(keys)
        ]

    def _run(self, levels: IntArray) -> None:
        self._levels = np.concatenate([self._levels, levels])
        assignment = np.concatenate([self._extra.job.assignment, self._drawn.assignment(levels)])
        for first, stop, rows in self._extra.run(assignment):
            answers = self.answers(rows, first, stop)
            self.happened |= set(answers)
            for key in self._answers.keys() | answers.keys():
                before = self._answers.get(key, np.zeros(first - self._start, dtype=np.bool_))
                now = answers.get(key, np.zeros(stop - first, dtype=np.bool_))
                self._answers[key] = np.concatenate([before, now])

    def answers(self, rows: pa.Table, first: int, stop: int) -> dict[_Key, BoolArray]:
        """Return (C,) whether each event happens in futures ``first`` to ``stop - 1``, if it does in any."""
        encounters = encounters_of_rows(rows)
        ids = np.array(self._drawn.track_ids)
        low, high = (np.sort([ids[encounters.first], ids[encounters.second]], axis=0)).tolist()
        happens: dict[_Key, BoolArray] = {}
        answers = answers_of(encounters)
        for event in EVENTS:
            for row in np.flatnonzero(answers[event]).tolist():
                key = (low[row], high[row], event)
                if key not in happens:
                    happens[key] = np.zeros(stop - first, dtype=np.bool_)
                happens[key][encounters.future[row] - first] = True
        return happens

    def keep(self) -> None:
        """Write the assignments and outcomes of the futures; their parts are removed."""
        from pyarrow import parquet

        job = self._extra.job
        folder, own = job.folder, job.assignment[self._start :]
        table = assignments_table(job.scene, own, job.models.names)
        future = np.asarray(table["future"]) + self._start
        parquet.write_table(table.set_column(0, "future", pa.array(future)), folder / "assignments.parquet")
        rows = [
            {"future": self._start + at, "track_id": one, "other_id": other, "event": event}
            for (one, other, event), happens in sorted(self._answers.items())
            for at in np.flatnonzero(happens).tolist()
        ]
        numbers = [(name, pa.int64()) for name in ("future", "track_id", "other_id")]
        schema = pa.schema([*numbers, ("event", pa.string())])
        parquet.write_table(pa.Table.from_pylist(rows, schema=schema), folder / "outcomes.parquet")
        shutil.rmtree(folder / PARTS, ignore_errors=True)


def _searched(
    drawn: DrawnModels, futures: _Futures, seen: dict[_Key, BoolArray], keys: Sequence[_Key], most: int
) -> Search:
    never = np.zeros(len(drawn.levels), dtype=np.bool_)
    search = Search(
        drawn.each,
        drawn.levels,
        np.stack([seen.get(key, never) for key in keys], axis=1)
        if keys
        else np.empty((len(never), 0), dtype=np.bool_),
        [[drawn.track_ids.index(track) for track in key[:2]] for key in keys],
        rank=[int(key[2] != COLLISION) for key in keys],
        rng=future_generator(futures.seed, 0, EXACT_STREAM),
    )
    search.run(lambda rows: futures.run(rows, keys), most=most - SECOND)
    return search


def _believed(
    drawn: DrawnModels,
    futures: _Futures,
    search: Search,
    seen: dict[_Key, BoolArray],
    keys: Sequence[_Key],
    most: int,
) -> tuple[dict[_Key, InfluenceTable], dict[_Key, str]]:
    """Return the tables that their check confirms, and why the others stay sampled."""

    def wrong(events: Iterable[int], levels: IntArray, truth: BoolArray) -> list[int]:
        settled = [event for event in events if search.is_settled(event)]
        return [e for e in settled if (search.predict(e, levels) != truth[:, e]).any()]

    everything = range(len(keys))
    learned = wrong(everything, search.drawn, search.seen)
    for event in learned:
        search.reopen(event)
    search.run(lambda rows: futures.run(rows, keys), most=most - FRESH if learned else most)
    if any(search.is_settled(event) for event in learned):
        fresh = search.random(FRESH)
        differs = wrong(learned, fresh, futures.run(fresh, keys))
    else:  # nothing to check anew: the rest is for the others
        search.run(lambda rows: futures.run(rows, keys), most=most)
        differs = learned
    differs = [*differs, *wrong(set(everything) - set(learned), search.drawn, search.seen)]
    tables: dict[_Key, InfluenceTable] = {}
    sampled: dict[_Key, str] = {}
    for event, key in enumerate(keys):
        if event in differs:
            sampled[key] = "its table and a drawn future differ"
        elif not search.is_settled(event):
            many = len(search.influence(event)) > MAX_VEHICLES or event in search.failed
            sampled[key] = f"more than {MAX_VEHICLES} vehicles decide it" if many else "it needs more futures"
        else:
            tables[key] = _table(drawn, search, event, FRESH if event in learned else len(drawn.levels))
    return tables, sampled


def _table(drawn: DrawnModels, search: Search, event: int, checked: int) -> InfluenceTable:
    return reduced(drawn.table(search.cubes(event), search.influence(event), checked))
