"""Metrics of crossing paths: gap time of planned paths, post-encroachment time (PET) of driven tracks.

Undefined without a crossing ahead of both.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.base import FOLLOWING_RAD, PlannedPaths
from scex_sumo.metrics.pairs.paths_ahead import Crossings, PathsAhead, paths_ahead
from scex_sumo.metrics.pairs.scenes import Entries, Scenes

_MIN_SINE = np.sin(FOLLOWING_RAD)


def gap_time(scenes: Scenes) -> Entries:
    """Compute the difference of arrival times at the first crossing, at present speed, of ordered pairs, s.

    Undefined where one vehicle stands. Source: Allen et al. 1978.
    """
    if scenes.planned is None or len(scenes.pairs[0]) == 0:
        return _nothing()
    return scenes.of_near_pairs(_gap_time)


def _gap_time(scenes: Scenes) -> Entries:
    crossing = scenes.once(paths_ahead).next_crossings
    speed, (own, other) = scenes.speed.reshape(-1), scenes.flat_of(crossing.where)
    time = np.abs(crossing.own / speed[own] - crossing.other / speed[other])
    return Entries(where=crossing.where, value=time)


def _area_reach(scenes: Scenes, crossing: Crossings) -> tuple[FloatArray, FloatArray]:
    pair, scene = np.divmod(crossing.where, scenes.count)
    sine = np.maximum(crossing.sine, _MIN_SINE)
    cosine = np.sqrt(np.maximum(1 - sine * sine, 0.0))
    own_length, other_length, own_width, other_width = (
        scenes.size_of(size, side[pair], scene) / 2
        for size in (scenes.length, scenes.width)
        for side in scenes.ordered_pairs
    )
    own_reach = (other_width + own_width * cosine) / sine + own_length
    other_reach = (own_width + other_width * cosine) / sine + other_length
    return own_reach, other_reach


def pet(scenes: Scenes) -> Entries:
    """Compute the time between the first vehicle's exit and the second one's arrival, of ordered pairs, s.

    It uses driven tracks, in simulated futures too, and areas as wide as the vehicles. It leaves out tracks
    that cross below the following angle, because a follower weaves across its leader's track. Undefined where
    the recording ends before the first vehicle has left. Source: Allen et al. 1978.
    """
    return scenes.of_near_pairs(_pet) if len(scenes.pairs[0]) else _nothing()


def _pet(scenes: Scenes) -> Entries:
    paths, times = _driven_paths(scenes), []
    crossing = paths.first_crossings(min_sine=_MIN_SINE)
    sides = zip(
        scenes.flat_of(crossing.where),
        (crossing.own, crossing.other),
        _area_reach(scenes, crossing),
        strict=True,
    )
    for index, arc, reach in sides:
        line = paths.line.reshape(-1)[index]
        along = arc - paths.offset.reshape(-1)[index]
        # A track has one column per step.
        times += [
            paths.lines.column_at(line, along - reach) * scenes.tracks.step_s,
            paths.lines.column_at(line, along + reach, leaving=True) * scenes.tracks.step_s,
        ]
    own_in, own_out, other_in, other_out = times
    time = np.where(own_in <= other_in, other_in - own_out, own_in - other_out)
    known = np.flatnonzero(np.isfinite(time))  # the first one leaves within the recording
    return Entries(where=crossing.where[known], value=np.maximum(time[known], 0.0))


def _driven_paths(scenes: Scenes) -> PathsAhead:
    planned = scenes.planned
    driven = planned if planned is not None and planned.driven else PlannedPaths.from_tracks(scenes.tracks)
    return PathsAhead(scenes, driven, moving_only=False)


def _nothing() -> Entries:
    return Entries(where=np.empty(0, dtype=np.int64), value=np.empty(0))
