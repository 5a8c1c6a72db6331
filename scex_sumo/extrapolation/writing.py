"""Tables of a run, written from the parts of its batches, and notes for its reader, one phrase each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.errors import listed
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.loop.crashes import touch_in_simulation
from scex_sumo.extrapolation.loop.measure import Recorded, overlapping_at_first
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.design import DENSITIES, densities_table
from scex_sumo.results.folder import ResultFolder, assignments_table, tracks_table, values_table
from scex_sumo.results.parts import TABLES, Part, joined_parts
from scex_sumo.results.road import save_intentions, save_road
from scex_sumo.results.run import PAIR_OUTCOMES, UNDER_TEST
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.results.tables.encounters import ENCOUNTERS, encounters_table, outcomes_table
from scex_sumo.results.tables.outcomes import collided
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene

ROWS_AT_ONCE = 1 << 18  # of tracks, in a row group of Parquet

COPY_M = 0.5  # between the centres of copies


def write_tables(folder: ResultFolder, job: Job, recorded: Recorded | None) -> Part:
    """Write the tables of a run whose parts are all in the folder.

    Returns:
        All futures, with their first step only.
    """
    parts = _written_tracks(folder, job)
    all_futures = joined_parts([dataclasses.replace(p, states=p.states[:, :1].map(np.copy)) for p in parts])
    intervals = job.intervals
    columns = job.settings.columns
    metrics = values_table(columns, all_futures.values, all_futures.defined, all_futures.futures)
    assert all_futures.collisions is not None and all_futures.encounters is not None
    hit = collided(all_futures.collisions, all_futures.futures)
    folder.write_table("metrics.parquet", metrics.append_column(COLLISION, pa.array(hit)))
    met = rows_in(Encounters, all_futures.encounters)
    folder.write_table(
        ENCOUNTERS,
        encounters_table(
            met,
            track_ids=job.scene.track_ids,
            models=np.array(job.models.names)[job.assignment],
            intervals=intervals,
            collisions=all_futures.collisions,
            scene=job.scene,
        ),
    )
    folder.write_table(PAIR_OUTCOMES, outcomes_table(met, job.scene.track_ids))
    if all_futures.tested is not None:
        values, defined = all_futures.tested.swapaxes(0, 1)
        folder.write_table(UNDER_TEST, values_table(columns, values, defined > 0, all_futures.futures))
    for name in TABLES:
        if name != "encounters" and (table := getattr(all_futures, name)) is not None:
            folder.write_table(f"{name}.parquet", table)
    folder.write_table("assignments.parquet", assignments_table(job.scene, job.assignment, job.models.names))
    folder.write_table(DENSITIES, densities_table(metrics, columns, intervals))
    if recorded is not None:
        recorded_row = values_table(columns, recorded.values.values, recorded.values.defined)
        folder.write_table("recorded.parquet", recorded_row)
    write_tracks(folder.path / "seed.csv", job.scene)
    save_road(folder.path, job.road)
    save_intentions(folder.path, job.scene)
    return all_futures


def _written_tracks(folder: ResultFolder, job: Job) -> Iterator[Part]:
    rows = job.scene.vehicles * (LOGGED_HISTORY + job.settings.steps)
    with folder.writer("tracks.parquet") as add_tracks:
        for part in folder.in_order(len(job.assignment), size=max(ROWS_AT_ONCE // rows, 1)):
            add_tracks(tracks_table(job.scene, part))
            yield part


def outcome_notes(scene: SeedScene, recorded: Recorded | None) -> list[str]:
    """Return notes on copies of vehicles, overlapping boxes, and the recording's end."""
    notes, ids, now = [], scene.track_ids.tolist(), scene.now
    overlaps = overlapping_at_first(scene)
    copies = {(a, b) for a, b in overlaps if math.hypot(now.x[a] - now.x[b], now.y[a] - now.y[b]) < COPY_M}
    if copies:
        again = sorted({ids[b] for _, b in copies})
        notes.append(
            f"warning: {len(again)} of {len(ids)} vehicles lie on another one and look like its copies: "
            f"{listed(again, most=12)}; leave them out of the tracks"
        )
    pairs = [f"{ids[a]} and {ids[b]}" for a, b in overlaps if (a, b) not in copies]
    if pairs:
        notes.append(f"boxes that overlap at the seed moment do not count as collisions: {listed(pairs)}")
    nets = touch_in_simulation(scene)
    if nets:
        pairs = [f"{scene.names[a]} and {scene.names[b]}" for a, b in nets]
        notes.append(
            "bodies that touch as SUMO itself drives, where the net's lanes split or turn sharply, "
            f"do not count as collisions: {listed(pairs)}"
        )
    if recorded is None:
        return notes
    info = recorded_info(scene, recorded)
    twins = {frozenset((ids[a], ids[b])) for a, b in (*copies, *nets)}
    seen = [
        f"{a} and {b} at {time_s:.1f} s"
        for a, b, time_s in info["overlaps"]
        if frozenset((a, b)) not in twins
    ]
    if seen:
        notes.append(f"overlaps of recorded boxes, which are inexact, are no collisions: {listed(seen)}")
    gone, end = info["left"], int(recorded.last_step.max())
    together = [track for track, step in gone.items() if step == end]
    if end < recorded.steps and len(together) > 1:
        notes.append(
            f"recorded: the recording, and so the recorded column, ends {end * STEP_S:g} s after the moment"
        )
        gone = {track: step for track, step in gone.items() if step < end}
    if gone:
        notes.append(
            f"recorded: {len(gone)} of {len(ids)} vehicles leave within the time of a future; only the "
            f"recorded column misses them from then on: {listed(gone, most=12)}"
        )
    return notes


def recorded_info(scene: SeedScene, recorded: Recorded) -> dict[str, Any]:
    """Return the entry ``recorded`` of ``run.json``.

    ``left``: last step of each vehicle that leaves, by track id. ``overlaps``: two track ids and the time, s.
    """
    ids, hits = scene.track_ids.tolist(), recorded.overlaps
    pairs = zip(hits.first.tolist(), hits.second.tolist(), hits.time_s.tolist(), strict=True)
    last = zip(ids, recorded.last_step.tolist(), strict=True)
    return {
        "left": {str(track): step for track, step in last if step < recorded.steps},
        "overlaps": [[ids[a], ids[b], time_s] for a, b, time_s in pairs],
    }
