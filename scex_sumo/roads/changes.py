"""Lane changes: the lanes of a route with few of them, and centrelines over them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, arc_lengths, length_of, nearest, without_repeats
from scex_sumo.road import Lane

CHANGE_LENGTH_M = 40.0  # at the end of a lane
MAX_LOOK_AHEAD = 12  # lanes of a route whose changes are avoided


def with_few_changes(
    known: Mapping[int, Lane],
    length: Mapping[int, float],
    lane: int,
    s: float,
    allowed: frozenset[int],
    horizon: float,
) -> tuple[int, ...]:
    """Return the lanes of a route over a distance, with as few lane changes as the allowed lanes need."""

    def ahead(lane: int) -> list[int]:
        return [i for i in known[lane].successors if i in allowed and i in known]

    @cache
    def reach(lane: int, edges: int = MAX_LOOK_AHEAD) -> float:
        """Return how far the route leads on from the begin of a lane without a change."""
        return length[lane] + max((reach(i, edges - 1) for i in ahead(lane) if edges), default=0.0)

    route: tuple[int, ...] = (lane,)
    covered = length[lane] - s
    while covered < horizon:
        options = ahead(route[-1])
        gain = bool(options)
        if not gain:
            beside = {known[route[-1]].left, known[route[-1]].right} - {*route}
            options = [i for i in beside if i in allowed and i in known and reach(i) > length[i]]
        if not options:
            break
        best = max(options, key=lambda i: (reach(i), -i))
        route, covered = (*route, best), covered + (length[best] if gain else 0.0)
    return route


def change_lanes(
    known: Mapping[int, Lane], lanes: tuple[int, ...], line: FloatArray, from_m: float
) -> tuple[FloatArray, FloatArray, int]:
    """Bend the end of a line over into the lanes beside it, after arc length ``from_m``.

    Return the bent line, the rest of the line of the lanes ahead, and how many lanes that line has.
    """
    ends = length_of(line)
    begin = min(max(ends - CHANGE_LENGTH_M, from_m, 0.0), ends)
    done = begin + CHANGE_LENGTH_M
    other, count = _neighbour(known, lanes, line[-1], done - ends)
    return *blend_over(_beside(line, other, done), other, CHANGE_LENGTH_M), count


def blend_over(line: FloatArray, other: FloatArray, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Return a line blended into another one over its last ``length_m``, and the rest of that one."""
    arc = arc_lengths(line)
    start = max(0.0, arc[-1] - length_m)
    s = np.linspace(start, arc[-1], max(2, int((arc[-1] - start) / 1.0) + 1))
    here = along(line, s)
    s_other = np.maximum.accumulate([nearest(other, float(px), float(py)) for px, py in here])
    t = (s - start) / max(arc[-1] - start, 1e-9)
    weight = (t**3 * (10 - 15 * t + 6 * t**2))[:, None]  # slope and curvature are zero at both ends
    bent = (1 - weight) * here + weight * along(other, s_other)
    reached = arc_lengths(other)
    rest = np.vstack([along(other, s_other[-1:]), other[reached > s_other[-1]]])
    return np.vstack([line[arc < start], bent]), rest


def _neighbour(
    known: Mapping[int, Lane], lanes: tuple[int, ...], end: FloatArray, more_m: float
) -> tuple[FloatArray, int]:
    """Return the line of lanes beside a lane to a length past its end, straight on if short; how many."""
    line, count = known[lanes[0]].centreline, 1
    while length_of(line) - nearest(line, *end) <= more_m:
        if count == len(lanes):
            last = np.diff(without_repeats(line)[-2:], axis=0)
            return np.vstack([line, line[-1:] + CHANGE_LENGTH_M * last / np.hypot(*last[0])]), count
        if lanes[count] not in known[lanes[count - 1]].successors:
            break
        line = np.vstack([line, known[lanes[count]].centreline])
        count += 1
    return line, count


def _beside(line: FloatArray, other: FloatArray, length_m: float) -> FloatArray:
    foot = nearest(other, *line[-1])
    after = other[arc_lengths(other) > foot] + line[-1] - along(other, np.array([foot]))
    longer = np.vstack([line, after])
    arc = arc_lengths(longer)
    return np.vstack([longer[arc < length_m], along(longer, np.array([min(length_m, arc[-1])]))])
