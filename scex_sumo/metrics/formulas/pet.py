"""Post-encroachment time (PET): what really passed between one vehicle leaving and the next one coming."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.formulas.gap_time import area_reach
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.paths_ahead import Crossings, PathsAhead, first_on_own_path
from scex_sumo.metrics.pairs.scenes import Scenes


def post_encroachment_time(
    *, own_in: FloatArray, own_out: FloatArray, other_in: FloatArray, other_out: FloatArray
) -> FloatArray:
    """Time between the first vehicle leaving a place and the second one reaching it.

    Args:
        own_in: (N,) when the row's own vehicle reaches it, s.
        own_out: (N,) when it has left it, s; inf where it does not within the recording.
        other_in: (N,) when the other one reaches it, s.
        other_out: (N,) when it has left it, s.

    Returns:
        (N,) s; 0 where both were there at the same time, -inf where the first one stays.

    Source: Allen et al. 1978.
    """
    own_first = own_in <= other_in
    gap = np.where(own_first, other_in - own_out, own_in - other_out)
    return np.where(np.isneginf(gap), gap, np.maximum(gap, 0.0))


def pet(scenes: Scenes) -> Entries:
    """PET of all ordered pairs whose driven tracks cross ahead of both, s.

    It looks at the tracks that were driven, in child scenarios too, from each step on. Preset ``paper`` takes
    the centres' times at the crossing point, preset ``path`` bumpers and the conflict area, and leaves out
    tracks that cross below the following angle: whoever follows in a lane weaves across the leader's track.
    Undefined without a crossing, after one of them has passed it, and where the recording ends before the
    first one has left it.
    """
    if len(scenes.pairs[0]) == 0:
        return Entries(where=np.empty(0, dtype=np.int64), value=np.empty(0))
    return scenes.of_ordered_pairs(_at_areas if scenes.preset.conflict_area else _at_points)


def _at_points(scenes: Scenes) -> Entries:
    paths = scenes.once(_driven_paths)
    crossing = first_on_own_path(paths.crossings, 2 * scenes.distance.size)
    nowhere = np.zeros(crossing.where.size)
    return _passed(scenes, crossing, nowhere, nowhere)


def _at_areas(scenes: Scenes) -> Entries:
    crossings = scenes.once(_driven_paths).crossings
    least = np.sin(min(scenes.parameters.following_angle, np.pi / 2))
    crossings = crossings.take(np.flatnonzero(crossings.sine >= least))
    crossing = first_on_own_path(crossings, 2 * scenes.distance.size)
    return _passed(scenes, crossing, *area_reach(scenes, crossing))


def _passed(scenes: Scenes, crossing: Crossings, own_reach: FloatArray, other_reach: FloatArray) -> Entries:
    """PET at crossings, with how far from them either vehicle's centre still is in the way, (X,) m."""
    paths, times = scenes.once(_driven_paths), []
    sides = ((crossing.own, own_reach), (crossing.other, other_reach))
    for at, (arc, reach) in zip(scenes.flat_of(crossing.where), sides, strict=True):
        line = paths.line.reshape(-1)[at]
        along = arc - paths.offset.reshape(-1)[at]
        # A track has one column per step.
        times += [
            paths.lines.column_at(line, along - reach) * scenes.tracks.step_s,
            paths.lines.column_at(line, along + reach, leaving=True) * scenes.tracks.step_s,
        ]
    own_in, own_out, other_in, other_out = times
    time = post_encroachment_time(own_in=own_in, own_out=own_out, other_in=other_in, other_out=other_out)
    known = np.flatnonzero(np.isfinite(time))
    return Entries(where=crossing.where[known], value=time[known])


def _driven_paths(scenes: Scenes) -> PathsAhead:
    """The tracks driven from each step on."""
    planned = scenes.planned
    driven = planned if planned is not None and planned.driven else PlannedPaths.from_tracks(scenes.tracks)
    return PathsAhead(scenes, driven, moving_only=False)
