"""Copies: several samples of one track with one time stamp, also of two road users under one id."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows, segments_of
from scex_sumo.errors import listed

APART_M = 3.0
"""Samples farther apart than this are two road users, or one of them is wrong."""
FIT_M = 1.5
"""A sample so close to the middle between its neighbours in time fits them."""


def drop_copies(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Keep one sample per track and stamp.

    The one nearest to the middle of the samples before and after; where those are doubled too (two camera
    frames for every stamp), always the first, so that the kept ones are equally far apart in time. Where they
    are far apart, and none fits or those before or after are doubled too, two road users share an id: all
    samples of that while are left out, as long as the stamps are doubled.

    Args:
        rows: the samples.

    Returns:
        The rows, and a phrase for each of both findings.
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
    shared = _whole_whiles(unclear, last > first, rows.track[first])
    keep = np.zeros(len(rows), bool)
    keep[kept[~shared]] = True
    found = []
    dropped = int((again & ~shared[group]).sum())
    if dropped:
        found.append(f"{dropped} samples with the time stamp of another dropped")
    if shared.any():
        found.append(_shared_ids(rows, first[shared]))
    taken = rows.take(keep)
    new = (np.diff(taken.segment) != 0) | (np.diff(segments_of(taken.track, taken.timestamp_ms)) != 0)
    return taken.with_columns(segment=np.append(0, np.cumsum(new)).astype(np.int64)[: len(taken)]), found


def _whole_whiles(unclear: BoolArray, doubled: BoolArray, track: IntArray) -> BoolArray:
    """(G,) groups of samples that lie in an uninterrupted row of doubled stamps with an unclear one."""
    begins = np.append(True, (np.diff(track) != 0) | (doubled[1:] != doubled[:-1]))
    run: IntArray = np.cumsum(begins) - 1
    has = np.zeros(int(run[-1]) + 1, bool)
    has[run[unclear]] = True
    return np.asarray(has[run] & doubled)


def _shared_ids(rows: TrackRows, begins: IntArray) -> str:
    """What was found of ids that two road users share; ``begins`` are rows at each stamp of those whiles."""
    labels = [rows.labels[k] for k in np.unique(rows.track[begins])]
    return f"one track id of two road users for a while, {len(begins)} stamps left out: {listed(labels)}"


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
