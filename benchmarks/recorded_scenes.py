"""Seed scenes of the recordings in a part of the time split."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from scex_sumo.converters.datasets.recordings import (
    find_recordings,
    load_recording,
    recording_moments,
    seed_at,
)
from scex_sumo.errors import TrackError
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.training.data.split import Part, Split, split_moments

SETS = ("taf_bw", "mona")


def recorded(
    folder: Path, part: Part, *, every_s: float, most: int = 10_000, min_history: int = 0
) -> Iterator[SeedScene]:
    """Moments of the recordings below a folder that belong to a part of the split, evenly thinned.

    Args:
        folder: of one data set.
        part: of the split.
        every_s: least time between two moments, s.
        most: moments of one recording.
        min_history: vehicles with fewer recorded previous steps are left out.
    """
    for recording in find_recordings([folder]):
        loaded = load_recording(recording)
        times: list[float] = []
        for moment in split_moments(recording_moments(loaded, every_s=STEP_S), Split())[part]:
            if not times or moment.time_s >= times[-1] + every_s - 1e-6:
                times.append(moment.time_s)
        for time_s in times[:: max(1, -(-len(times) // most))]:
            try:
                yield seed_at(loaded, time_s, min_history=min_history)
            except TrackError:  # nobody has been recorded for long enough
                continue
