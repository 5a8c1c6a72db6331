"""Copies: several samples of one track with one time stamp."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.errors import TrackError

APART_M = 3.0
"""Samples farther apart than this are two road users, or one of them is wrong."""
FIT_M = 1.5
"""A sample so close to the middle between its neighbours in time fits them."""


def drop_copies(rows: TrackRows, path: str) -> tuple[TrackRows, list[str]]:
    """Keep one sample per track and stamp.

    The one nearest to the middle of the samples before and after; where those are doubled too (two camera
    frames for every stamp), always the first, so that the kept ones are equally far apart in time.

    Args:
        rows: the samples.
        path: the file, for the error.

    Raises:
        TrackError: they are far apart, and none fits or those before or after are doubled too: two road users
            share an id.
    """
    again = np.append(False, (np.diff(rows.track) == 0) & (np.diff(rows.timestamp_ms) == 0))
    if not again.any():
        return rows, []
    first = np.flatnonzero(~again)
    group: IntArray = np.cumsum(~again) - 1
    last = np.append(first[1:], len(rows)) - 1
    off, lonely = _off_middle(rows, group, first, last)
    spread = np.zeros(len(first))
    np.maximum.at(spread, group, np.hypot(rows.x - rows.x[first[group]], rows.y - rows.y[first[group]]))
    best = np.lexsort((off, group))[first]
    kept = np.where(lonely, best, first)
    unclear = (spread > APART_M) & ~(lonely & (off[kept] < FIT_M))
    if unclear.any():
        where = int(np.argmax(unclear))
        row = first[where]
        raise TrackError(
            f"{path}: track {rows.labels[rows.track[row]]} is twice at {rows.timestamp_ms[row]:.0f} ms, "
            f"{spread[where]:.1f} m apart (frame {rows.frame_id[row]}); give every road user its own track_id"
        )
    keep = np.zeros(len(rows), bool)
    keep[kept] = True
    return rows.take(keep), [f"{int(again.sum())} samples with the time stamp of another dropped"]


def _off_middle(
    rows: TrackRows, group: IntArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, BoolArray]:
    """(N,) distance to the middle of the samples before and after, m; inf where there is neither.

    Also (G,) whether the groups of samples before and after are single samples.
    """
    size = last - first + 1
    track = rows.track[first]
    joined = np.diff(track) == 0
    has_before, has_after = np.append(False, joined), np.append(joined, False)
    before, after = np.maximum(first - 1, 0), np.minimum(last + 1, len(rows) - 1)
    count = has_before.astype(float) + has_after
    middle = [
        (np.where(has_before, values[before], 0.0) + np.where(has_after, values[after], 0.0))
        / np.maximum(count, 1.0)
        for values in (rows.x, rows.y)
    ]
    off = np.hypot(rows.x - middle[0][group], rows.y - middle[1][group])
    single_before = ~has_before | (np.roll(size, 1) == 1)
    single_after = ~has_after | (np.roll(size, -1) == 1)
    return np.where(count[group] > 0.0, off, np.inf), single_before & single_after
