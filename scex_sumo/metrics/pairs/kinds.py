"""Equal tracks of children: they differ only where the drivers near a vehicle do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray, distinct
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.scenes import Preset, Scenes, Shared
from scex_sumo.scene import States

WORTH = 0.9  # of the pairs differ at most, for equal ones to be worth finding


def shared_pairs(
    tracks: SceneTracks, planned: PlannedPaths | None, *, preset: Preset, parameters: MetricParameters
) -> Shared | None:
    """Pairs of tracks, those that are equal to the bit, plans included, once; None where few are.

    Args:
        tracks: of C children; sizes and types must not depend on the child.
        planned: their planned paths.
        preset: who follows whom, and what a crossing is.
        parameters: constants of the metrics.
    """
    children, _, vehicles = tracks.states.shape
    sizes = tracks.length, tracks.width, np.empty(0) if tracks.types is None else tracks.types
    alike = all(np.ndim(values) == 1 for values in sizes)
    if children < 2 or vehicles < 2 or not alike or tracks.acceleration is not None:
        return None
    kinds, firsts = np.empty((vehicles, children), dtype=np.int64), list[IntArray]()
    for vehicle in range(vehicles):
        first, kind = distinct(_rows(tracks, planned, vehicle))
        kinds[vehicle] = kind + sum(map(len, firsts))
        firsts.append(first)
    child, owner = np.concatenate(firsts), np.repeat(np.arange(vehicles), [len(f) for f in firsts])
    one, two = (kinds[side] for side in np.triu_indices(vehicles, 1))
    if len(child) > WORTH * kinds.size:
        return None
    keys, row = np.unique(one * len(child) + two, return_inverse=True)
    if len(keys) > WORTH * one.size:
        return None
    scenes = Scenes(
        tracks=_picked(tracks, child, owner),
        planned=None if planned is None else _plans(planned, child, owner),
        parameters=parameters,
        preset=preset,
        chosen=(keys // len(child), keys % len(child)),
    )
    return Shared(scenes=scenes, row=row.reshape(one.shape))


def _rows(tracks: SceneTracks, planned: PlannedPaths | None, vehicle: int) -> FloatArray:
    """(C, K) all that is known of a vehicle in each child."""
    states = tracks.states
    parts = [values[:, :, vehicle] for values in (states.x, states.y, states.heading, states.speed)]
    if tracks.present is not None:
        parts.append(tracks.present[:, :, vehicle].astype(np.float64))
    if planned is not None:
        parts += [values[:, :, vehicle].reshape(len(values), -1) for values in (planned.x, planned.y)]
    return np.concatenate(parts, axis=1)


def _picked(tracks: SceneTracks, child: IntArray, vehicle: IntArray) -> SceneTracks:
    """One child of some vehicles of some children, (U,) each."""

    def some(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(values[child, :, vehicle].T[None])

    states = tracks.states
    return replace(
        tracks,
        states=States(
            x=some(states.x), y=some(states.y), heading=some(states.heading), speed=some(states.speed)
        ),
        length=tracks.length[vehicle],
        width=tracks.width[vehicle],
        present=None if tracks.present is None else tracks.present[child, :, vehicle].T[None],
        types=None if tracks.types is None else np.asarray(tracks.types)[vehicle],
    )


def _plans(planned: PlannedPaths, child: IntArray, vehicle: IntArray) -> PlannedPaths:
    """Planned paths of the same."""
    x, y = (np.ascontiguousarray(v[child, :, vehicle].swapaxes(0, 1)[None]) for v in (planned.x, planned.y))
    return replace(planned, x=x, y=y)
