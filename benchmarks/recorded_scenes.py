"""Seed scenes of the recordings in a part of the time split."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scex_sumo.converters.cleaning.smoothing import smooth
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Part, Split, split_moments
from scex_sumo.scene import STEP_S, SeedScene, States

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
            scene = seed_at(loaded, time_s)
            long = np.flatnonzero(scene.recorded_steps >= min_history).tolist()
            if len(long):
                yield scene.reordered(long, name=scene.name)


# Files of NGSIM are too short to be cut by time: these are kept for tests, the others are fitted to.
NGSIM_TEST = ("Lanker-2_20", "Lanker-2_21", "Lanker-2_24", "Peach-3_1", "Peach-3_2")
NGSIM_VALIDATION = ("Lanker-2_16",)
INTERACTION = Path("interaction", "recorded_trackfiles")
INTERACTION_SITES = tuple(
    f"DR_{site}" for site in ("DEU_Roundabout_OF", "USA_Roundabout_FT", "USA_Roundabout_SR",
                              "USA_Intersection_EP0", "USA_Intersection_GL")
)  # fmt: skip
# About 100 moments of each site of INTERACTION.
EVERY_S = {"taf_bw": 2.0, "mona": 5.0, "ngsim": 1.5} | dict(
    zip(INTERACTION_SITES, (2.0, 30.0, 15.0, 14.0, 28.0), strict=True)
)
MIN_MOVING = 2


def recorded_parts(data: Path, name: str, part: Part) -> Iterator[SeedScene]:
    """Moments of a part of a set, one site of INTERACTION each: NGSIM is split by file, others by time."""
    folder = INTERACTION / name if name in INTERACTION_SITES else Path(name)
    for recording in find_recordings([data / folder]):
        if name == "ngsim" and part != ngsim_part(recording.name):
            continue
        loaded = load_recording(recording)
        every = recording_moments(loaded, every_s=STEP_S)
        if name == "ngsim":
            begin, end = every[0].time_s + 1.0 - 1e-6, every[-1].time_s - 3.0 + 1e-6
            every = [moment for moment in every if begin <= moment.time_s <= end]
        else:
            every = split_moments(every, Split())[part]
        last = -np.inf
        for moment in every:
            if moment.time_s >= last + EVERY_S[name] - 1e-6:
                last = moment.time_s
                if moment.complete >= MIN_MOVING:
                    yield seed_at(loaded, moment.time_s)


SMOOTHED_M = 1.0  # noise of positions that smoothing takes for granted: a time of about 1.3 s
SLOWEST_MPS = 0.5  # slower vehicles keep the speed that was recorded


def smoothed(scene: SeedScene) -> SeedScene:
    """The same seed scene as better instruments might have recorded it: its past and its future, smoothed."""
    assert scene.future is not None and scene.future_valid is not None
    past = scene.history.shape[1]
    whole = States.concatenate([scene.history, scene.future], axis=1)
    ended = np.cumprod(scene.future_valid, axis=1).astype(bool)
    known = np.concatenate([np.ones(scene.history.shape, dtype=bool), ended], axis=1)
    vehicle, step = np.nonzero(known)
    points = np.column_stack([whole.x[known], whole.y[known]])
    x, y = whole.x.copy(), whole.y.copy()
    x[known], y[known] = smooth(points, (step * STEP_S).astype(np.float64), vehicle, SMOOTHED_M).T
    dx, dy = (np.gradient(values, STEP_S, axis=1) for values in (x, y))
    moves = known & (np.hypot(dx, dy) > SLOWEST_MPS)
    moves[np.arange(len(x)), known.sum(axis=1) - 1] = False  # their next place is another track's, or none
    speed = np.where(moves, np.cos(whole.heading) * dx + np.sin(whole.heading) * dy, whole.speed)
    whole = States(x=x, y=y, heading=whole.heading, speed=speed)
    return dataclasses.replace(scene, history=whole[:, :past], future=whole[:, past:])


def ngsim_part(name: str) -> Part:
    """The part that a file of NGSIM belongs to."""
    if any(file in name for file in NGSIM_TEST):
        return "test"
    return "validation" if any(file in name for file in NGSIM_VALIDATION) else "train"
