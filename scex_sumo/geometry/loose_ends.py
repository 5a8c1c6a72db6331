"""Loose ends of lanes: which lanes begin on other lanes, so that whoever starts there stands in traffic."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.geometry.polylines import length_of, project

INSIDE_M = 1.5  # nearer than this to another centreline a car stands in its traffic
SHORT_M = 2.5  # on a shorter lane a car stands at its end
END_M = 3.0  # so near to a loose end of the other lane both may well begin or end at the map's border


def begin_inside(
    shapes: Mapping[str, FloatArray],
    *,
    starts: Iterable[str],
    loose: Collection[str],
    apart: Mapping[str, Collection[str]],
) -> set[str]:
    """Lanes that begin on another lane, away from that one's own loose ends.

    Args:
        shapes: (P, 2) centreline of every lane, m.
        starts: lanes that nothing leads to.
        loose: lanes that nothing leads to, or that lead nowhere.
        apart: for a lane those that are no other traffic: its neighbours and what it leads to.
    """
    low = {name: line.min(axis=0) - INSIDE_M for name, line in shapes.items()}
    high = {name: line.max(axis=0) + INSIDE_M for name, line in shapes.items()}
    found = set()
    for start in starts:
        stub = length_of(shapes[start]) < SHORT_M
        tips = shapes[start][[0, -1] if stub else [0]]
        for name, line in shapes.items():
            if name == start or name in apart.get(start, ()):
                continue
            near = [tip for tip in tips if np.all(low[name] <= tip) and np.all(tip <= high[name])]
            if any(is_on(line, tip, loose_ends=name in loose) for tip in near):
                found.add(start)
                break
    return found


def is_on(line: FloatArray, point: FloatArray, *, loose_ends: bool) -> bool:
    """Whether a point lies on a lane; within 3 m of its ends only if these are not loose."""
    s, gap = project(point[None], line)
    at_end = min(float(s[0]), length_of(line) - float(s[0])) < END_M
    return bool(gap[0] < INSIDE_M) and not (loose_ends and at_end)
