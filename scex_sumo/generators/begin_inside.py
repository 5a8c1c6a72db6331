"""Lanes that begin on another lane."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import INSIDE_M, is_on, length_of

SHORT_M = 2.5  # on a shorter lane a vehicle stands at its end


def begin_inside(
    shapes: Mapping[str, FloatArray],
    *,
    starts: Iterable[str],
    loose: Collection[str],
    apart: Mapping[str, Collection[str]],
) -> set[str]:
    """Find lanes that begin on another lane, away from that lane's own loose ends.

    Args:
        shapes: (P, 2) centreline of every lane, m.
        starts: lanes without predecessor; ``loose`` without predecessor or successor.
        apart: by lane, its neighbours and successors.
    """
    low = {name: line.min(axis=0) - INSIDE_M for name, line in shapes.items()}
    high = {name: line.max(axis=0) + INSIDE_M for name, line in shapes.items()}
    inside = set()
    for start in starts:
        tips = shapes[start][[0, -1] if length_of(shapes[start]) < SHORT_M else [0]]
        for name, line in shapes.items():
            if name == start or name in apart.get(start, ()):
                continue
            near = [tip for tip in tips if np.all(low[name] <= tip) and np.all(tip <= high[name])]
            if any(is_on(line, tip, loose_ends=name in loose) for tip in near):
                inside.add(start)
                break
    return inside
