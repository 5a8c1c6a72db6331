"""Gap time: how far apart in time two vehicles reach the place where their planned paths cross.

Two paths cross at a point that both reach, the end points of segments included. Where they only run along the
same line (one vehicle behind the other on one lane) there is no crossing point, and the gap time is
undefined.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.paths_ahead import Crossings, first_on_own_path, paths_ahead
from scex_sumo.metrics.pairs.scenes import Scenes


def gap_time_at(
    *, own: FloatArray, other: FloatArray, own_speed: FloatArray, other_speed: FloatArray
) -> FloatArray:
    """Difference of the arrival times of two vehicles at a point, at present speed.

    Args:
        own: (N,) arc length of the first vehicle to the point, m.
        other: (N,) of the second, m.
        own_speed: (N,) m/s, positive.
        other_speed: (N,) m/s, positive.

    Returns:
        (N,) s.

    Source: Allen et al. 1978.
    """
    return np.abs(own / own_speed - other / other_speed)


def gap_time_of_area(
    *,
    own: FloatArray,
    other: FloatArray,
    own_reach: FloatArray,
    other_reach: FloatArray,
    own_speed: FloatArray,
    other_speed: FloatArray,
) -> FloatArray:
    """Time between the first vehicle leaving and the second one entering the conflict area, at present speed.

    Args:
        own: (N,) arc length of the first vehicle's centre to the crossing point, m.
        other: (N,) of the second, m.
        own_reach: (N,) distance of its centre from the crossing point within which it is in the area, m.
        other_reach: (N,) of the second, m.
        own_speed: (N,) m/s, positive.
        other_speed: (N,) m/s, positive.

    Returns:
        (N,) s; 0 where both would be in the area at the same time.
    """
    own_first = (other - other_reach) / other_speed - (own + own_reach) / own_speed
    other_first = (own - own_reach) / own_speed - (other + other_reach) / other_speed
    return np.maximum(np.maximum(own_first, other_first), 0.0)


def area_reach(scenes: Scenes, crossing: Crossings) -> tuple[FloatArray, FloatArray]:
    """(X,) half-length of the conflict area plus half the vehicle, along either path, m.

    The area is where strips as wide as the vehicles overlap. Paths that cross at a small angle merge rather
    than cross, and their strips overlap without end: angles below the following angle count as that.
    """
    children, steps = scenes.shape
    pair, scene = np.divmod(crossing.where, children * steps)
    child = scene // steps
    sine = np.maximum(crossing.sine, np.sin(min(scenes.parameters.following_angle, np.pi / 2)))
    cosine = np.sqrt(np.maximum(1 - sine * sine, 0.0))
    half = []
    for array in (scenes.length, scenes.width):
        half += [
            array[side[pair], child if array.shape[1] > 1 else 0, 0] / 2 for side in scenes.ordered_pairs
        ]
    own_length, other_length, own_width, other_width = half
    own_reach = (other_width + own_width * cosine) / sine + own_length
    other_reach = (own_width + other_width * cosine) / sine + other_length
    return own_reach, other_reach


def gap_time(scenes: Scenes) -> Entries:
    """Gap time of all ordered pairs whose planned paths cross ahead of both, s.

    Undefined without a crossing, after one of them has passed it, and where one of them stands. Preset
    ``path`` takes the conflict area in place of the crossing point.
    """
    if scenes.planned is None or len(scenes.pairs[0]) == 0:
        return Entries(where=np.empty(0, dtype=np.int64), value=np.empty(0))
    return scenes.of_ordered_pairs(_at_areas if scenes.preset.conflict_area else _at_points)


def _at_points(scenes: Scenes) -> Entries:
    crossing, own_speed, other_speed = _next_crossings(scenes)
    time = gap_time_at(own=crossing.own, other=crossing.other, own_speed=own_speed, other_speed=other_speed)
    return Entries(where=crossing.where, value=time)


def _at_areas(scenes: Scenes) -> Entries:
    crossing, own_speed, other_speed = _next_crossings(scenes)
    own_reach, other_reach = area_reach(scenes, crossing)
    time = gap_time_of_area(
        own=crossing.own,
        other=crossing.other,
        own_reach=own_reach,
        other_reach=other_reach,
        own_speed=own_speed,
        other_speed=other_speed,
    )
    return Entries(where=crossing.where, value=time)


def _next_crossings(scenes: Scenes) -> tuple[Crossings, FloatArray, FloatArray]:
    """Of every ordered pair the first crossing on its own path, and both speeds, m/s."""
    crossing = first_on_own_path(paths_ahead(scenes).crossings, 2 * scenes.distance.size)
    speed, (own, other) = scenes.speed.reshape(-1), scenes.flat_of(crossing.where)
    return crossing, speed[own], speed[other]
