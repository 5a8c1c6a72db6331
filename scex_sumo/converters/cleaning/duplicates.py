"""Duplicate samples of one track at one time stamp, and two road users under one id."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.tracks.rows import TrackRows, segments_of

APART_M = 3.0  # samples farther apart are two road users, or one of them is wrong
FIT_M = 1.5  # a sample this close to the middle between its neighbours in time fits them


def drop_duplicates(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Keep one sample per track and time stamp, with a phrase for each kind of defect.

    The sample nearest to the middle of those before and after is kept. Samples far apart belong to two road
    users if none fits: all are then left out while stamps are doubled.
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
    shared = _whole_runs(unclear, last > first, rows.track[first])
    keep = np.zeros(len(rows), bool)
    keep[kept[~shared]] = True
    found = []
    dropped = int((again & ~shared[group]).sum())
    if dropped:
        found.append(f"{dropped} duplicate samples dropped (same track, same time stamp)")
    if shared.any():
        found.append(_shared_ids(rows, first[shared]))
    taken = rows.take(keep)
    new = (np.diff(taken.segment) != 0) | (np.diff(segments_of(taken.track, taken.timestamp_ms)) != 0)
    return taken.with_columns(segment=np.append(0, np.cumsum(new)).astype(np.int64)[: len(taken)]), found


def _whole_runs(unclear: BoolArray, doubled: BoolArray, track: IntArray) -> BoolArray:
    begins = np.append(True, (np.diff(track) != 0) | (doubled[1:] != doubled[:-1]))
    run: IntArray = np.cumsum(begins) - 1
    has = np.zeros(int(run[-1]) + 1, bool)
    has[run[unclear]] = True
    return np.asarray(has[run] & doubled)


def _shared_ids(rows: TrackRows, begins: IntArray) -> str:
    labels = [rows.labels[k] for k in np.unique(rows.track[begins])]
    return f"{len(begins)} time stamps left out where two road users share one track id: {listed(labels)}"


def _off_middle(
    rows: TrackRows, group: IntArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, BoolArray]:
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
