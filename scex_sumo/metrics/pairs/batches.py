"""Batches of scenes: a few children at a time; equal tracks are evaluated once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, distinct
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.leaders import preset_named
from scex_sumo.metrics.pairs.scenes import Preset, Scenes, TrackPairs

BATCH_PAIR_STEPS = 1 << 18  # unordered pair-steps per batch
SHARED_PAIR_STEPS = 1 << 21  # of the children whose equal tracks are evaluated once; 0: never
MAX_DIFFERENT = 0.9  # share of different pairs above which the search for equal ones does not pay


def scene_batches(
    tracks: SceneTracks, planned: PlannedPaths | None, *, preset: str, parameters: MetricParameters
) -> Iterator[tuple[int, Scenes]]:
    """Yield scenes of a few children with the number of the first; the next batch drops derived values."""
    rules = preset_named(preset)
    children, _, vehicles = tracks.states.shape
    if planned is not None:
        planned.check_fit(tracks)
    per_child = max(tracks.steps * vehicles * (vehicles - 1) // 2, 1)
    size, group_size = (max(limit // per_child, 1) for limit in (BATCH_PAIR_STEPS, SHARED_PAIR_STEPS))
    for begin in range(0, max(children, 1), group_size):
        group = slice(begin, begin + group_size)
        some, plans = tracks.children(group), None if planned is None else planned.children(group)
        shared = track_pairs(some, plans, preset=rules, parameters=parameters)
        for start in range(0, max(some.states.shape[0], 1), size):
            part = slice(start, start + size)
            scenes = Scenes(
                tracks=some.children(part),
                planned=None if plans is None else plans.children(part),
                parameters=parameters,
                preset=rules,
                shared=None if shared is None else replace(shared, row=shared.row[:, part]),
            )
            yield begin + start, scenes
            scenes.release()
        if shared is not None:
            shared.scenes.release()


def track_pairs(
    tracks: SceneTracks, planned: PlannedPaths | None, *, preset: Preset, parameters: MetricParameters
) -> TrackPairs | None:
    """Find the different pairs of tracks; None if few are equal or sizes depend on the child."""
    children, _, vehicles = tracks.states.shape
    sizes = tracks.length, tracks.width, np.empty(0) if tracks.types is None else tracks.types
    same_sizes = all(np.ndim(values) == 1 for values in sizes)
    if children < 2 or vehicles < 2 or not same_sizes or tracks.acceleration is not None:
        return None
    number, firsts = np.empty((vehicles, children), dtype=np.int64), list[IntArray]()
    for vehicle in range(vehicles):
        first, of_child = distinct(_all_values(tracks, planned, vehicle))
        number[vehicle] = of_child + sum(map(len, firsts))
        firsts.append(first)
    child, owner = np.concatenate(firsts), np.repeat(np.arange(vehicles), [len(f) for f in firsts])
    one, two = (number[side] for side in np.triu_indices(vehicles, 1))
    if len(child) > MAX_DIFFERENT * number.size:
        return None
    keys, row = np.unique(one * len(child) + two, return_inverse=True)
    if len(keys) > MAX_DIFFERENT * one.size:
        return None
    scenes = Scenes(
        tracks=_tracks_of(tracks, child, owner),
        planned=None if planned is None else _plans_of(planned, child, owner),
        parameters=parameters,
        preset=preset,
        chosen=(keys // len(child), keys % len(child)),
    )
    return TrackPairs(scenes=scenes, row=row.reshape(one.shape))


def _all_values(tracks: SceneTracks, planned: PlannedPaths | None, vehicle: int) -> FloatArray:
    states = tracks.states
    parts = [values[:, :, vehicle] for values in (states.x, states.y, states.heading, states.speed)]
    if tracks.present is not None:
        parts.append(tracks.present[:, :, vehicle].astype(np.float64))
    if planned is not None:
        parts += [values[:, :, vehicle].reshape(len(values), -1) for values in (planned.x, planned.y)]
    return np.concatenate(parts, axis=1)


def _tracks_of(tracks: SceneTracks, child: IntArray, vehicle: IntArray) -> SceneTracks:
    return replace(
        tracks,
        states=tracks.states.map(lambda values: np.ascontiguousarray(values[child, :, vehicle].T[None])),
        length=tracks.length[vehicle],
        width=tracks.width[vehicle],
        present=None if tracks.present is None else tracks.present[child, :, vehicle].T[None],
        types=None if tracks.types is None else np.asarray(tracks.types)[vehicle],
    )


def _plans_of(planned: PlannedPaths, child: IntArray, vehicle: IntArray) -> PlannedPaths:
    x, y = (np.ascontiguousarray(v[child, :, vehicle].swapaxes(0, 1)[None]) for v in (planned.x, planned.y))
    return replace(planned, x=x, y=y)
