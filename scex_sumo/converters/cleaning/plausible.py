"""Plausible tracks: sizes and speeds that no road user has, and tracks that have them, left out."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.errors import listed

LONGEST_M, WIDEST_M = 60.0, 8.0
"""Longer and wider than any road user: trams reach 54 m, abnormal loads 7 m of width."""
SHORTEST_M = 0.1
FASTEST_MPS = 100.0
"""360 km/h; a track that is faster after all repairs is none."""


def drop_implausible(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Leave out tracks of implausible size, and those that are implausibly fast at some time.

    Returns:
        The rows, and a phrase with the numbers where some are left out.
    """
    size: BoolArray = (np.maximum(rows.length / LONGEST_M, rows.width / WIDEST_M) > 1.0) | (
        np.minimum(rows.length, rows.width) < SHORTEST_M
    )
    wrong_size = np.bincount(rows.track, size, rows.tracks) > 0
    too_fast = (np.bincount(rows.track, rows.speed > FASTEST_MPS, rows.tracks) > 0) & ~wrong_size
    if not (wrong_size | too_fast).any():
        return rows, []
    found = []
    for wrong, what in (
        (wrong_size, f"longer than {LONGEST_M:g} m, wider than {WIDEST_M:g} m or under {SHORTEST_M:g} m"),
        (too_fast, f"faster than {FASTEST_MPS:g} m/s"),
    ):
        labels = [rows.labels[k] for k in np.flatnonzero(wrong)]
        if labels:
            found.append(f"tracks {what} left out: {listed(labels)}")
    return rows.take(~(wrong_size | too_fast)[rows.track]), found
