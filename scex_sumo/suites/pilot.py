"""Pilot of a catalogue: where a driver that heeds nobody touches another vehicle.

What a function does where nobody acts cannot be known from actions of others. A blind driver shows it: some
candidates are drawn, and it drives a few futures of each, before the cases are chosen among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import ScexError
from scex_sumo.base.progress import Progress
from scex_sumo.behaviors.registry import parse_models
from scex_sumo.converters.registries import Recording
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import attempt
from scex_sumo.studies.moments.workers import moment_workers
from scex_sumo.suites.cut import cutter_of
from scex_sumo.suites.population import Population
from scex_sumo.suites.simulate import chances, simulate
from scex_sumo.suites.situation import Situation, situation_of
from scex_sumo.suites.testing.tasks import CaseTask, task_of_scene

BLIND: Final = "constant_velocity"
FUTURES: Final = 16
TIMES: Final = 8
"""Candidates of a pilot for each case."""
_LIMIT_S = 60.0
_STREAM = 1000  # its draws are not those of tests


def piloted(
    population: Population,
    count: int,
    recordings: Mapping[str, Recording],
    *,
    seed: int,
    workers: int = 1,
    tick: Progress | None = None,
) -> Population:
    """Return the candidates of a pilot for a number of cases; all without a pilot if there are no more."""
    if len(population) <= count:
        return population
    index, share = drawn(population.size(), population.kinds, TIMES * count, seed=seed)
    rows = [population.rows[k] for k in index.tolist()]
    touched = np.zeros((len(rows), 2))
    with closing(moment_workers(run_pilot, workers, None)) as pool:
        for done, (task, found) in enumerate(pool.run(_tasks(rows, recordings, seed)), 1):
            touched[int(task.ref.moment)] = (0.0, 0.0) if isinstance(found, Failure) else found
            if tick is not None:
                tick(done, len(rows))
    return replace(population, rows=rows, share=share, pilot=touched)


def drawn(size: FloatArray, kinds: Sequence[str], count: int, *, seed: int) -> tuple[IntArray, FloatArray]:
    """Return indices (n,) of candidates drawn by size, and (n,) for how many each stands; all up to a count.

    Systematic sampling, one kind after the other: inclusion probabilities are like the sizes, and at most 1.
    Sizes of a kind grow to those of `TIMES` candidates, so that each kind has some.
    """
    own, number = np.unique(kinds, return_inverse=True)
    size = size * np.maximum(1.0, TIMES / count / np.bincount(number, size, minlength=len(own)))[number]
    chance = np.minimum(1.0, size / size.sum() * count)
    while len(size) > count and (gap := count - chance.sum()) > 1e-6:
        chance = np.minimum(1.0, chance * (1 + gap / chance[chance < 1].sum()))
    if len(size) <= count:
        chance[:] = 1.0
    order = np.argsort(number, kind="stable")
    start = np.random.default_rng([seed, _STREAM]).random()
    steps = np.floor(np.concatenate([[0.0], np.cumsum(chance[order])]) + start + 1e-9)
    index = np.sort(order[np.diff(steps) > 0])
    return index, 1 / chance[index]


def touches(situation: Situation, *, seed: int) -> tuple[float, float]:
    """Return how often the blind driver touches where nobody acts, and its P of a contact."""
    outcomes = simulate(situation, parse_models(BLIND)[0], FUTURES, seed=seed + _STREAM)
    typical, acting = chances(situation, outcomes)
    return typical, 1 - (1 - typical) * (1 - acting)


def run_pilot(task: CaseTask, road: bytes | None = None) -> tuple[float, float] | Failure:
    """Return `touches` of a candidate, or why it failed."""
    return attempt(_run, task, road)


def _run(task: CaseTask, scene: SeedScene, road: bytes) -> tuple[float, float]:
    return touches(situation_of(scene, task.initiator, task.responder), seed=task.seed)


def _tasks(
    rows: Sequence[Mapping[str, Any]], recordings: Mapping[str, Recording], seed: int
) -> Iterator[CaseTask]:
    """Yield the tasks of candidates, named by their numbers; without those that cannot be cut."""
    cut, (spec,) = None, parse_models(BLIND)
    for k in sorted(range(len(rows)), key=lambda k: (rows[k]["recording"], k)):
        row = rows[k]
        cut = (
            cut
            if cut is not None and cut.name == row["recording"]
            else cutter_of(recordings, row["recording"])
        )
        try:
            scene = cut.scenes(row)[1]
        except ScexError:
            continue  # said where such a candidate is chosen
        both = row["track_id"], row["other_id"]
        yield task_of_scene(str(k), scene, both, spec, FUTURES, seed=seed, limit_s=_LIMIT_S)
