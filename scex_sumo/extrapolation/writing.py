"""Tables of a run: what it leaves in its folder, from the parts that its batches left there."""

from __future__ import annotations

import dataclasses

import numpy as np

from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.converters.moments.writer import write_tracks
from scex_sumo.evaluation.plans import PLANS, plans_table
from scex_sumo.extrapolation.fallbacks import FALLBACKS
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.measure import handover_jumps, measure_recorded
from scex_sumo.results.folder import ResultFolder, assignments_table, tracks_table, values_table
from scex_sumo.results.parts import Part, joined
from scex_sumo.results.run import densities_table
from scex_sumo.results.under_test import UNDER_TEST
from scex_sumo.scene import LOGGED_HISTORY

HANDOVER_M = 0.5  # a jump of a vehicle's centre that SUMO's own drivers are told of
ROWS_AT_ONCE = 1 << 20  # of tracks, written to the disk: a row group of Parquet


def write_tables(folder: ResultFolder, job: Job) -> Part:
    """Write the tables of a run whose children are all in the folder.

    Returns:
        The children, of their states the first step only, without plans.

    Raises:
        ResultError: a file cannot be written, or children are missing.
    """
    part = _write_tracks(folder, job)
    columns = job.settings.columns
    metrics = values_table(columns, part.values, part.defined, part.children)
    folder.write_table("metrics.parquet", metrics)
    folder.write_table("worst.parquet", part.worst)
    if part.tested is not None:
        values, defined = part.tested
        folder.write_table(UNDER_TEST, values_table(columns, values, defined > 0, part.children))
    if part.fallbacks is not None:
        folder.write_table(FALLBACKS, part.fallbacks)
    folder.write_table("assignments.parquet", assignments_table(job.scene, job.assignment, job.models.names))
    folder.write_table("densities.parquet", densities_table(metrics))
    recorded = measure_recorded(job.scene, job.settings.steps, metrics=job.settings.measured)
    if recorded is not None:
        folder.write_table("recorded.parquet", values_table(columns, recorded.values, recorded.defined))
    write_tracks(folder.path / "seed.csv", job.scene)
    return part


def _write_tracks(folder: ResultFolder, job: Job) -> Part:
    """Tracks and plans, some children at a time, so that memory does not grow with their number."""
    left, rows = [], job.scene.vehicles * (LOGGED_HISTORY + job.settings.steps)
    with folder.writer("tracks.parquet") as add_tracks, folder.writer(PLANS) as add_plans:
        for part in folder.in_order(len(job.assignment), size=max(ROWS_AT_ONCE // rows, 1)):
            add_tracks(tracks_table(job.scene, part))
            if (plans := plans_table(job.scene, part, job.settings.replan)) is not None:
                add_plans(plans)
            first = part.states[:, :1].map(np.copy)
            left.append(dataclasses.replace(part, states=first, plan_x=None, plan_y=None))
    return joined(left)


def handover_notes(job: Job, part: Part) -> list[str]:
    """Whether SUMO moved vehicles when it took them over, one phrase.

    Args:
        job: the run.
        part: its children, with the first step of their states.
    """
    by_sumo = np.array([isinstance(model, SumoDriver) for model in job.models.built])[job.assignment]
    jumps = handover_jumps(job.scene, part.states[:, 0], by_sumo)
    far = int((jumps > HANDOVER_M).sum())
    if far == 0:
        return []
    return [
        f"SUMO turned {far} of {len(jumps)} vehicles that it drives into their lanes in the first step, "
        f"by up to {jumps.max():.1f} m of their centres; the metrics of that step feel it"
    ]
