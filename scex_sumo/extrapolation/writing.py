"""Tables of a run, written from the parts of its batches."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator
from functools import partial

import numpy as np
import pyarrow as pa

from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.evaluation.encounters import ENCOUNTERS, encounters_table, outcomes_table
from scex_sumo.evaluation.outcomes import COLLISIONS, collided, encounters_of_rows
from scex_sumo.evaluation.plans import PLANS, plans_table
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.measure import Recorded
from scex_sumo.extrapolation.rollout import FALLBACKS
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.workers import Workers, succeeded
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.design import DENSITIES, densities_table
from scex_sumo.results.folder import ResultFolder, assignments_table, tracks_table, values_table
from scex_sumo.results.parts import Part, joined_parts
from scex_sumo.results.run import PAIR_OUTCOMES
from scex_sumo.results.under_test import UNDER_TEST
from scex_sumo.scene import LOGGED_HISTORY, SeedScene

ROWS_AT_ONCE = 1 << 18  # of tracks, in a row group of Parquet


def write_tables(folder: ResultFolder, job: Job, recorded: Recorded | None, *, workers: Workers) -> Part:
    """Write the tables of a run whose parts are all in the folder.

    Args:
        workers: if there are any, one writes the tracks meanwhile.

    Returns:
        All children, with their first step only, without plans.
    """
    these = folder, job.scene, len(job.assignment), job.settings
    written = workers.submit(partial(_write_tracks, *these), where="over the tracks")
    parts = _write_each(*these) if written is None else _each(*these, plans=False)
    part, intervals = joined_parts([_first_step(part) for part in parts]), job.intervals
    columns, settings = job.settings.columns, job.settings
    metrics = values_table(columns, part.values, part.defined, part.children)
    assert part.collisions is not None and part.encounters is not None
    hit = collided(part.collisions, part.children)
    folder.write_table("metrics.parquet", metrics.append_column(COLLISION, pa.array(hit)))
    folder.write_table("worst.parquet", part.worst)
    folder.write_table(COLLISIONS, part.collisions)
    met = encounters_of_rows(part.encounters)
    folder.write_table(
        ENCOUNTERS,
        encounters_table(
            met,
            track_ids=job.scene.track_ids,
            models=np.array(job.models.names)[job.assignment],
            intervals=intervals,
            collisions=part.collisions,
            road=job.road,
        ),
    )
    folder.write_table(PAIR_OUTCOMES, outcomes_table(met, job.scene.track_ids))
    if part.tested is not None:
        values, defined = part.tested
        folder.write_table(UNDER_TEST, values_table(columns, values, defined > 0, part.children))
    if part.fallbacks is not None:
        folder.write_table(FALLBACKS, part.fallbacks)
    folder.write_table("assignments.parquet", assignments_table(job.scene, job.assignment, job.models.names))
    folder.write_table(DENSITIES, densities_table(metrics, columns, intervals, reflect=settings.reflect))
    if recorded is not None:
        found = recorded.values
        folder.write_table("recorded.parquet", values_table(columns, found.values, found.defined))
    write_tracks(folder.path / "seed.csv", job.scene)
    if written is not None and not succeeded(written):
        _write_tracks(*these)
    return part


def _each(
    folder: ResultFolder, scene: SeedScene, children: int, settings: RunSettings, *, plans: bool = True
) -> Iterator[Part]:
    rows = scene.vehicles * (LOGGED_HISTORY + settings.steps)
    return folder.in_order(children, size=max(ROWS_AT_ONCE // rows, 1), plans=plans)


def _write_each(
    folder: ResultFolder, scene: SeedScene, children: int, settings: RunSettings
) -> Iterator[Part]:
    with folder.writer("tracks.parquet") as add_tracks, folder.writer(PLANS) as add_plans:
        for part in _each(folder, scene, children, settings):
            add_tracks(tracks_table(scene, part))
            if (plans := plans_table(scene, part, settings.replan)) is not None:
                add_plans(plans)
            yield part


def _write_tracks(folder: ResultFolder, scene: SeedScene, children: int, settings: RunSettings) -> None:
    deque(_write_each(folder, scene, children, settings), maxlen=0)


def _first_step(part: Part) -> Part:
    return dataclasses.replace(part, states=part.states[:, :1].map(np.copy), plan_x=None, plan_y=None)
