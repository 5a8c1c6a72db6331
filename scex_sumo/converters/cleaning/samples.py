"""Samples of a recording that do not belong there: several at one time stamp, and those at jumps."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.tracks.rows import JUMP_M, TrackRows, numbered_again

MIN_PIECE = 5  # samples of a piece between jumps
APART_M = 3.0  # samples farther apart are two road users, or one of them is wrong
FIT_M = 1.5  # a sample this close to the middle between its neighbours in time fits them


def without_duplicates(rows: TrackRows, duplicate: BoolArray) -> tuple[TrackRows, list[str]]:
    """Keep one sample per track and time stamp; ``duplicate`` (N,) are those at the stamp of the one before.

    The sample nearest to the middle of those before and after is kept. Samples far apart belong to two road
    users if none fits: all are then left out while stamps are doubled.
    """
    first = np.flatnonzero(~duplicate)
    group: IntArray = np.cumsum(~duplicate) - 1
    last = np.append(first[1:], len(rows)) - 1
    distance, between_singles = _off_middle(rows, group, first, last)
    spread = np.zeros(len(first))
    np.maximum.at(spread, group, np.hypot(rows.x - rows.x[first[group]], rows.y - rows.y[first[group]]))
    best = np.lexsort((distance, group))[first]
    kept = np.where(between_singles, best, first)
    unclear = (spread > APART_M) & ~(between_singles & (distance[kept] < FIT_M))
    doubled, track = last > first, rows.track[first]
    run = np.cumsum(np.append(0, (np.diff(track) != 0) | (doubled[1:] != doubled[:-1])))
    shared = np.isin(run, run[unclear]) & doubled
    keep = np.zeros(len(rows), bool)
    keep[kept[~shared]] = True
    phrases = []
    dropped = int((duplicate & ~shared[group]).sum())
    if dropped:
        phrases.append(f"{dropped} duplicate samples dropped (same track, same time stamp)")
    if shared.any():
        labels = [rows.labels[k] for k in np.unique(rows.track[first[shared]])]
        phrases.append(
            f"{shared.sum()} time stamps left out where two road users share one track id: {listed(labels)}"
        )
    return numbered_again(rows.take(keep)), phrases


def _off_middle(
    rows: TrackRows, group: IntArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, BoolArray]:
    size = last - first + 1
    track = rows.track[first]
    joined = np.diff(track) == 0
    has_before, has_after = np.append(False, joined), np.append(joined, False)
    before, after = np.maximum(first - 1, 0), np.minimum(last + 1, len(rows) - 1)
    count = has_before.astype(float) + has_after
    around = np.array([has_before * xy[before] + has_after * xy[after] for xy in (rows.x, rows.y)])
    x, y = (around / np.maximum(count, 1.0))[:, group]
    distance = np.hypot(rows.x - x, rows.y - y)
    single_before = ~has_before | (np.roll(size, 1) == 1)
    single_after = ~has_after | (np.roll(size, -1) == 1)
    return np.where(count[group] > 0.0, distance, np.inf), single_before & single_after


def without_jumps(rows: TrackRows, jump: BoolArray) -> tuple[TrackRows, list[str]]:
    """Leave out samples at jumps, else cut the track there; ``jump`` (N - 1,): whether a step is one."""
    joined = np.append(np.diff(rows.segment) == 0, [False, False])  # the last one is before the first row
    drop, cut = np.zeros((2, len(rows)), bool)
    for i in np.flatnonzero(jump):  # step from row i to row i + 1
        if drop[i]:
            continue
        if joined[i + 1] and jump[i + 1]:
            drop[i + 1] = True
        elif not joined[i - 1]:
            drop[i] = True
        elif not joined[i + 1]:
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
    return numbered_again(rows.with_columns(segment=segment).take(~drop)), phrases
