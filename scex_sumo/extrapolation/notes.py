"""Notes of a run: what its reader should know before the numbers, one phrase each."""

from __future__ import annotations

from typing import Any

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
    told = recorded_info(scene, recorded)
    assert told is not None
    seen = [f"{a} and {b} at {time_s:.1f} s" for a, b, time_s in told["overlaps"]]
    if seen:
        notes.append(f"recorded boxes overlap, as inexact boxes do, and are no collisions: {', '.join(seen)}")
    gone = [int(track) for track in told["left"]]
    if gone:
        notes.append(
            f"recorded: {len(gone)} of {len(ids)} vehicles leave within the time of a child, and are absent "
            f"from then on in the recorded column only: {listing(gone)}"
        )
    return notes


def recorded_info(scene: SeedScene, recorded: Recorded | None) -> dict[str, Any] | None:
    """What ``run.json`` says of the recorded future; None where there is none.

    ``left``: last step of each vehicle that leaves within the time of a child, by track id; ``overlaps``:
    boxes that overlap, as two track ids and the time in s.
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
