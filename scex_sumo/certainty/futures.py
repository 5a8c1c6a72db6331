"""Extra futures of a run: chosen ones beside those that it draws, of which only encounters count."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.certainty.search import Cube
from scex_sumo.certainty.tables import Draws, InfluenceTable
from scex_sumo.extrapolation.job import Job, batch_size, batches_of
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.parts import PARTS, Parts

PLAIN_WORLDS: Final = ("sumo", "checked")
"""Worlds with the same result as arrays alone, if SUMO drives nobody."""

VEHICLES_EACH: Final = 100
"""Vehicles, over all futures, from which another process helps with a round."""

_AT_ONCE = 2000  # futures that are read at once


class DrawnModels:
    """Models that the vehicles and people of a run draw, and its assignments as levels of them.

    Attributes:
        draws: the models, those of people last; people that draw one of a single model are fixed.
        fixed: (V,) vehicles that draw none.
        levels: (C, V) of the drawn futures; 0 for fixed vehicles.
        each: (V) share of each level by vehicle.
    """

    def __init__(self, job: Job) -> None:
        models, tracks = job.models, job.scene.track_ids
        walking = next((w for w in models.people.values() if len(w) > 1), {})
        weights = {k: spec.weight for k, spec in enumerate(models.drawn) if spec.weight > 0}
        self._index = np.array([*weights, *walking], dtype=np.int64)
        self.track_ids = [int(track) for track in tracks]
        people = np.zeros(len(tracks), dtype=np.bool_) if job.scene.people is None else job.scene.people
        draws = people & ~np.isin(tracks, list(models.fixed))
        draws &= np.array([len(models.people.get(kind, ())) > 1 for kind in job.scene.types])
        self.fixed = job.fixed & ~draws
        self._offset = np.where(draws, len(weights), 0)
        named, of_people = (
            {models.names[k]: weight for k, weight in group.items()} for group in (weights, walking)
        )
        self.draws = Draws.of(named, of_people, tracks[draws].tolist())
        place = np.zeros(len(models.specs), dtype=np.int64)
        place[self._index] = np.arange(len(self._index))
        self.levels = np.where(self.fixed, 0, place[job.assignment] - self._offset)
        self.each = [
            np.ones(1) if fixed else self.draws.shares[self.draws.own(track)]
            for fixed, track in zip(self.fixed.tolist(), self.track_ids, strict=True)
        ]
        self._first = job.assignment[0]

    def assignment(self, levels: IntArray) -> IntArray:
        """Return the models (R, V) of levels."""
        return np.where(self.fixed, self._first, self._index[levels + self._offset])

    def table(self, cubes: Iterable[Cube], vehicles: Iterable[int], checked: int) -> InfluenceTable:
        """Return the table of an event that happens under partial assignments of levels."""
        ids, offset = self.track_ids, self._offset
        models = [{ids[v]: level + int(offset[v]) for v, level in cube} for cube in cubes]
        return InfluenceTable.of_cubes(models, sorted(ids[v] for v in vehicles), self.draws, checked)


def encounters_only(settings: RunSettings) -> RunSettings:
    """Return the settings of futures of which only encounters count."""
    world = "plain" if settings.world in PLAIN_WORLDS else settings.world
    return dataclasses.replace(settings, metrics=("gap",), keep_plans=False, thresholds={}, world=world)


class ExtraFutures:
    """Extra futures, run by the workers of a run and numbered after its own.

    Attributes:
        job: of the run and its extra futures so far, in a folder of their own.
    """

    def __init__(self, job: Job, folder: Path, workers: Workers) -> None:
        self.job = dataclasses.replace(job, settings=encounters_only(job.settings), folder=folder, gui=False)
        self._workers = workers
        (folder / PARTS).mkdir(parents=True, exist_ok=True)

    def run(
        self, assignment: IntArray, route_draw: FloatArray | None = None
    ) -> Iterator[tuple[int, int, pa.Table]]:
        """Run more futures, and return first future, future after the last, and encounters of some at a time.

        Those that an interrupted run has finished are not run again.

        Args:
            assignment: (C, V) of all futures; those that are not in the job yet are run.
            route_draw: (C, V), as of `Job`.
        """
        first, stop = len(self.job.assignment), len(assignment)
        self.job = dataclasses.replace(self.job, assignment=assignment, route_draw=route_draw)
        done = set(Parts(self.job.folder).futures.tolist())
        left = [future for future in range(first, stop) if future not in done]
        few = dataclasses.replace(self.job, assignment=assignment[first:])
        processes = min(self._workers.free, max(len(left) * few.scene.vehicles // VEHICLES_EACH, 1))
        size = min(batch_size(few), math.ceil(max(len(left), 1) / processes))
        for _ in self._workers.run(self.job, batches_of(left, size, apart=self.job.apart)):
            pass
        return self._encounters(first, stop)

    def _encounters(self, first: int, stop: int) -> Iterator[tuple[int, int, pa.Table]]:
        parts = Parts(self.job.folder)
        for start in range(first, stop, _AT_ONCE):
            end = min(start + _AT_ONCE, stop)
            rows = parts.read(start, end, plans=False).encounters
            assert rows is not None
            yield start, end, rows
