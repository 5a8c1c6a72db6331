"""Metrics of crossing paths: gap time of planned paths, post-encroachment time (PET) of driven tracks.

Undefined without a crossing ahead of both. Preset ``path`` uses conflict areas instead of points.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.pairs.paths_ahead import Crossings, PathsAhead, paths_ahead
from scex_sumo.metrics.pairs.scenes import Entries, Scenes


def gap_time(scenes: Scenes) -> Entries:
    """Compute the difference of arrival times at the first crossing, at present speed, of ordered pairs, s.

    Undefined where one vehicle stands. With conflict areas: from the first vehicle's exit to the second one's
    entry; 0 if both would be inside at the same time. Source: Allen et al. 1978.
    """
    if scenes.planned is None or len(scenes.pairs[0]) == 0:
        return _nothing()
    return scenes.of_meeting_pairs(_gap_time_at_areas if scenes.preset.conflict_area else _gap_time_at_points)


def _gap_time_at_points(scenes: Scenes) -> Entries:
    crossing, own_speed, other_speed = _next_crossings(scenes)
    time = np.abs(crossing.own / own_speed - crossing.other / other_speed)
    return Entries(where=crossing.where, value=time)


def _gap_time_at_areas(scenes: Scenes) -> Entries:
    crossing, own_speed, other_speed = _next_crossings(scenes)
    own_reach, other_reach = _area_reach(scenes, crossing)
    own, other = crossing.own, crossing.other
    own_first = (other - other_reach) / other_speed - (own + own_reach) / own_speed
    other_first = (own - own_reach) / own_speed - (other + other_reach) / other_speed
    time = np.maximum(np.maximum(own_first, other_first), 0.0)
    return Entries(where=crossing.where, value=time)


def _next_crossings(scenes: Scenes) -> tuple[Crossings, FloatArray, FloatArray]:
    crossing = paths_ahead(scenes).next_crossings
    speed, (own, other) = scenes.speed.reshape(-1), scenes.flat_of(crossing.where)
    return crossing, speed[own], speed[other]


def _area_reach(scenes: Scenes, crossing: Crossings) -> tuple[FloatArray, FloatArray]:
    pair, scene = np.divmod(crossing.where, scenes.count)
    sine = np.maximum(crossing.sine, np.sin(min(scenes.parameters.following_angle, np.pi / 2)))
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

    It uses driven tracks, in simulated futures too. Preset ``path`` leaves out tracks that cross below the
    following angle, because a follower weaves across its leader's track. Undefined where the recording ends
    before the first vehicle has left. Source: Allen et al. 1978.
    """
    if len(scenes.pairs[0]) == 0:
        return _nothing()
    return scenes.of_meeting_pairs(_pet_at_areas if scenes.preset.conflict_area else _pet_at_points)


def _pet_at_points(scenes: Scenes) -> Entries:
    crossing = scenes.once(_driven_paths).next_crossings
    no_reach = np.zeros(crossing.where.size)
    return _time_between(scenes, crossing, no_reach, no_reach)


def _pet_at_areas(scenes: Scenes) -> Entries:
    min_sine = float(np.sin(min(scenes.parameters.following_angle, np.pi / 2)))
    crossing = scenes.once(_driven_paths).first_crossings(min_sine=min_sine)
    return _time_between(scenes, crossing, *_area_reach(scenes, crossing))


def _time_between(
    scenes: Scenes, crossing: Crossings, own_reach: FloatArray, other_reach: FloatArray
) -> Entries:
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
    time = np.where(own_in <= other_in, other_in - own_out, own_in - other_out)
    known = np.flatnonzero(np.isfinite(time))  # the first one leaves within the recording
    return Entries(where=crossing.where[known], value=np.maximum(time[known], 0.0))


def _driven_paths(scenes: Scenes) -> PathsAhead:
    planned = scenes.planned
    driven = planned if planned is not None and planned.driven else PlannedPaths.from_tracks(scenes.tracks)
    return PathsAhead(scenes, driven, moving_only=False)


def _nothing() -> Entries:
    return Entries(where=np.empty(0, dtype=np.int64), value=np.empty(0))
