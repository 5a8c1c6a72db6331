"""Notes of a run: what its reader should know before the numbers, one phrase each."""

from __future__ import annotations

import numpy as np

from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.extrapolation.assignments import listing
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.measure import Recorded, handover_jumps, overlapping_at_first
from scex_sumo.results.parts import Part
from scex_sumo.scene import SeedScene

HANDOVER_M = 0.5  # a jump of a vehicle's centre that SUMO's own drivers are told of


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


def outcome_notes(scene: SeedScene, recorded: Recorded | None) -> list[str]:
    """What is no collision although boxes overlap, and who is missing in the recorded row."""
    notes, ids = [], [int(track) for track in scene.track_ids]
    pairs = [f"{ids[a]} and {ids[b]}" for a, b in overlapping_at_first(scene)]
    if pairs:
        notes.append(f"boxes overlap at the seed moment already, which is no collision: {', '.join(pairs)}")
    if recorded is None:
        return notes
    hits = recorded.overlaps
    seen = [
        f"{ids[a]} and {ids[b]} at {t:.1f} s"
        for a, b, t in zip(hits.first.tolist(), hits.second.tolist(), hits.time_s.tolist(), strict=True)
    ]
    if seen:
        notes.append(f"recorded boxes overlap, as inexact boxes do, and are no collisions: {', '.join(seen)}")
    gone = [t for t, last in zip(ids, recorded.last_step.tolist(), strict=True) if last < recorded.steps]
    if gone:
        notes.append(
            f"recorded: {len(gone)} of {len(ids)} vehicles leave within the time of a child, and are absent "
            f"from then on in the recorded column only: {listing(gone)}"
        )
    return notes
