"""Outliers of recordings: samples recorded twice, and jumps of positions."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.cleaning.motion import JUMP_M
from scex_sumo.converters.tracks.rows import TrackRows, segments_of

JUMP_EXCESS_M = 1.5  # a jump is so much longer than the usual step there
MIN_PIECE = 5  # samples of a piece between jumps
APART_M = 3.0  # samples farther apart are two road users, or one of them is wrong
FIT_M = 1.5  # a sample this close to the middle between its neighbours in time fits them


def drop_duplicates(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Keep one sample per track and time stamp, with a phrase for each kind of defect.

    The sample nearest to the middle of those before and after is kept. Samples far apart belong to two road
    users if none fits: all are then left out while stamps are doubled.
    """
    again = np.append(False, (np.diff(rows.track) == 0) & (np.diff(rows.timestamp_ms) == 0))
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
    phrases = []
    dropped = int((again & ~shared[group]).sum())
    if dropped:
        phrases.append(f"{dropped} duplicate samples dropped (same track, same time stamp)")
    if shared.any():
        phrases.append(_shared_ids(rows, first[shared]))
    return _numbered_again(rows.take(keep)), phrases


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


def cut_jumps(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Leave out samples at jumps, else cut the track there; a phrase for each."""
    jump = _jumps(rows)
    if not jump.any():
        return rows, []
    joined = np.diff(rows.segment) == 0
    drop = np.zeros(len(rows), bool)
    cut = np.zeros(len(rows), bool)
    for i in np.flatnonzero(jump):  # step from row i to row i + 1
        if drop[i]:
            continue
        if i + 1 < len(joined) and joined[i + 1] and jump[i + 1]:
            drop[i + 1] = True
        elif i == 0 or not joined[i - 1]:
            drop[i] = True
        elif i + 1 >= len(joined) or not joined[i + 1]:
            drop[i + 1] = True
        else:
            cut[i + 1] = True
    segment = rows.segment + np.cumsum(cut)
    size = np.bincount(segment[~drop], minlength=segment[-1] + 1)
    touched = np.isin(rows.segment, rows.segment[cut])
    drop |= touched & (size[segment] < MIN_PIECE)
    cut &= ~drop & np.append(False, ~drop[:-1])
    phrases = []
    if drop.any():
        phrases.append(f"{int(drop.sum())} samples at jumps over {JUMP_M:g} m dropped")
    if cut.any():
        tracks = len(np.unique(rows.track[cut]))
        phrases.append(f"{tracks} tracks cut at jumps over {JUMP_M:g} m")
    return _numbered_again(rows.with_columns(segment=segment).take(~drop)), phrases


def _numbered_again(rows: TrackRows) -> TrackRows:
    """Number segments from 0 on after rows were left out; gaps that are too long now begin new ones."""
    new = (np.diff(rows.segment) != 0) | (np.diff(segments_of(rows.track, rows.timestamp_ms)) != 0)
    return rows.with_columns(segment=np.append(0, np.cumsum(new)).astype(np.int64)[: len(rows)])


def _jumps(rows: TrackRows) -> BoolArray:
    joined: BoolArray = np.diff(rows.segment) == 0
    if not joined.any():
        return joined
    length = np.hypot(np.diff(rows.x), np.diff(rows.y))
    # No jump if another step nearby is about as long: this spares highways the search below.
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(np.where(joined, length, np.inf), 5, constant_values=np.inf), 11
    )
    far = joined & (length > JUMP_M) & (length - around.min(axis=1) > JUMP_EXCESS_M)
    elapsed = np.diff(rows.timestamp_ms) / 1000.0
    jump = np.zeros(len(length), bool)
    for i in np.flatnonzero(far):
        window = slice(max(0, i - 5), i + 6)
        same = joined[window] & (rows.segment[:-1][window] == rows.segment[i])
        usual = np.median(length[window][same] / elapsed[window][same])
        jump[i] = length[i] - usual * elapsed[i] > JUMP_EXCESS_M
    return jump
