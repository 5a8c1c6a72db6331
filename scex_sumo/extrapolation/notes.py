"""Notes of a run for its reader, one phrase each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scex_sumo.base.errors import listed
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.extrapolation.assignments import listing
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.measure import Recorded, handover_jumps, overlapping_at_first
from scex_sumo.results.parts import Part
from scex_sumo.scene import STEP_S, SeedScene

COPY_M = 0.5  # between the centres of copies
HANDOVER_M = 0.5  # jump that gets a note


def handover_notes(job: Job, part: Part) -> list[str]:
    """Return a note if SUMO moved vehicles in the first step."""
    by_sumo = np.array([isinstance(model, SumoDriver) for model in job.models.built])[job.assignment]
    jumps = handover_jumps(job.scene, part.states[:, 0], by_sumo)
    far = int((jumps > HANDOVER_M).sum())
    if far == 0:
        return []
    return [
        f"SUMO turned {far} of {len(jumps)} vehicles that it drives into their lanes in the first step, "
        f"by up to {jumps.max():.1f} m; this affects the metrics of that step"
    ]


def outcome_notes(scene: SeedScene, recorded: Recorded | None) -> list[str]:
    """Return notes on copies of vehicles, overlapping boxes, and the recording's end."""
    notes, ids, now = [], [int(track) for track in scene.track_ids], scene.now
    overlaps = overlapping_at_first(scene)
    copies = {(a, b) for a, b in overlaps if math.hypot(now.x[a] - now.x[b], now.y[a] - now.y[b]) < COPY_M}
    if copies:
        again = sorted({ids[b] for _, b in copies})
        notes.append(
            f"warning: {len(again)} of {len(ids)} vehicles lie on another one and look like its copies: "
            f"{listing(again)}; leave them out of the tracks"
        )
    pairs = [f"{ids[a]} and {ids[b]}" for a, b in overlaps if (a, b) not in copies]
    if pairs:
        notes.append(f"boxes that overlap at the seed moment do not count as collisions: {listed(pairs)}")
    if recorded is None:
        return notes
    info = recorded_info(scene, recorded)
    assert info is not None
    twins = {frozenset((ids[a], ids[b])) for a, b in copies}
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
            f"recorded column misses them from then on: {listing([int(track) for track in gone])}"
        )
    return notes


def recorded_info(scene: SeedScene, recorded: Recorded | None) -> dict[str, Any] | None:
    """Return the entry ``recorded`` of ``run.json``; None without a recorded future.

    ``left``: last step of each vehicle that leaves, by track id. ``overlaps``: two track ids and the time, s.
    """
    if recorded is None:
        return None
    ids, hits = [int(track) for track in scene.track_ids], recorded.overlaps
    pairs = zip(hits.first.tolist(), hits.second.tolist(), hits.time_s.tolist(), strict=True)
    last = recorded.last_step.tolist()
    return {
        "left": {str(ids[v]): last[v] for v in range(len(ids)) if last[v] < recorded.steps},
        "overlaps": [[ids[a], ids[b], time_s] for a, b, time_s in pairs],
    }
