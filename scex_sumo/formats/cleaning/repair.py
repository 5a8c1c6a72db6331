"""Repair of recordings: counts defects, and repairs those that are unambiguous."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.datasets.repairs import Repair
from scex_sumo.converters.tracks.rows import FORWARD_MPS, STANDING_MPS, TrackRows, TrackTable, segments_of
from scex_sumo.formats.cleaning.heading import repair_headings
from scex_sumo.formats.cleaning.smooth import derivative, position_noise, smooth

# A step this long is a jump, if it is also so much longer than the track's usual step there.
JUMP_M, JUMP_EXCESS_M = 3.0, 1.5
MIN_PIECE = 5  # samples of a piece between jumps
# A tracker warms up if two of a track's first five steps have the same position at a rising speed.
FROZEN_STEPS, WARM_UP_RISE_MPS = 2, 0.5
WARM_UP_S = 2.0  # dropped then
# Velocities contradict the motion if their integral is off by more than this factor, or points elsewhere.
VELOCITY_RATIO, VELOCITY_COSINE = 1.2, 0.9
JUDGED_PATH_M = 3.0  # least summed displacement of a judged track
NOISE_M = 0.02  # positions with more white noise than this per axis are smoothed
MAX_LENGTH_M, MAX_WIDTH_M = 60.0, 8.0  # trams reach 54 m
MIN_SIZE_M = 0.1
MAX_SPEED_MPS = 100.0  # 360 km/h

APART_M = 3.0  # samples farther apart are two road users, or one of them is wrong
FIT_M = 1.5  # a sample this close to the middle between its neighbours in time fits them


def repair_tracks(table: TrackTable, *, exact: bool = False) -> tuple[TrackTable, tuple[str, ...]]:
    """Repair a recording, or one case of a file of cases.

    In order: duplicates, tracker warm-up, jumps, velocities and noise, headings, implausible sizes or speeds.
    Exact recordings, from a simulation, are only cut at jumps and cleared of what is implausible.

    Returns a phrase with counts for each kind of defect, too.
    """
    vehicles, findings = _repair(table.vehicles, table, FORWARD_MPS, exact=exact)
    # Pedestrians and cyclists face where they go.
    others, more = _repair(table.others, table, STANDING_MPS, exact=exact)
    if more:
        both = "repaired in the same way" if findings else "; ".join(more)
        findings.append(f"pedestrians and cyclists: {both}")
    return replace(table, vehicles=vehicles, others=others), tuple(findings)


def _repair(
    rows: TrackRows, table: TrackTable, forward_mps: float, *, exact: bool
) -> tuple[TrackRows, list[str]]:
    findings: list[str] = []
    if not len(rows):
        return rows, findings
    steps: tuple[Callable[[TrackRows], tuple[TrackRows, list[str]]], ...] = (
        drop_duplicates,
        lambda rows: (rows, []) if table.has_cases else _drop_warm_up(rows),
        _cut_jumps,
        _renew_motion,
        lambda rows: repair_headings(rows, forward_mps),
        _drop_implausible,
    )
    for step in (_cut_jumps, _drop_implausible) if exact else steps:
        rows, found = step(rows)
        findings += found
        if not len(rows):
            break
    return rows, findings


def _drop_warm_up(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Drop the start of tracks whose filter had not yet converged."""
    start, piece = rows.pieces[0], rows.piece
    since = np.arange(len(rows)) - start[piece]
    still = (np.diff(rows.x) == 0.0) & (np.diff(rows.y) == 0.0) & (since[1:] > 0) & (since[1:] <= 5)
    faster = np.diff(rows.speed) > 0.0
    moving = (rows.speed[1:] + rows.speed[:-1]) / 2.0 > 0.15
    frozen = np.bincount(piece[1:][still & faster & moving], minlength=piece[-1] + 1) >= FROZEN_STEPS
    age_ms = rows.timestamp_ms - rows.timestamp_ms[start][piece]
    soon = np.maximum.reduceat(np.where(age_ms <= 1000.0, rows.speed, 0.0), start)
    frozen &= soon - rows.speed[start] > WARM_UP_RISE_MPS
    if not frozen.any():
        return rows, []
    keep = ~frozen[piece] | (age_ms >= 1000.0 * WARM_UP_S)
    cold = len(np.unique(rows.track[start][frozen]))
    return rows.take(keep), [
        f"tracker warm-up: first {WARM_UP_S:g} s of {cold} of {rows.tracks} tracks dropped"
    ]


def _cut_jumps(rows: TrackRows) -> tuple[TrackRows, list[str]]:
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
    found = []
    if drop.any():
        found.append(f"{int(drop.sum())} samples at jumps over {JUMP_M:g} m dropped")
    if cut.any():
        tracks = len(np.unique(rows.track[cut]))
        found.append(f"{tracks} tracks cut at jumps over {JUMP_M:g} m")
    return _numbered_again(rows.with_columns(segment=segment).take(~drop)), found


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


def _renew_motion(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    if not (np.diff(rows.segment) == 0).any():
        return rows, []
    time_s = rows.timestamp_ms / 1000.0
    points = np.stack((rows.x, rows.y), axis=1)
    judged, wrong, factor = _contradictions(rows, points, time_s)
    noise = position_noise(points, time_s, rows.segment)
    found = []
    if wrong.any():
        found.append(
            f"velocities of {int(wrong.sum())} of {int(judged.sum())} moving tracks contradict the motion"
            f" ({_how_wrong(factor[wrong])}): recomputed from positions"
        )
    jitter = noise > NOISE_M
    everything = jitter or 2 * wrong.sum() > judged.sum()
    if not everything and not wrong.any():
        return rows, found
    chosen = np.full(len(rows), True) if everything else wrong[rows.track]
    smoothed = smooth(points, time_s, rows.segment, noise)
    velocity = derivative(smoothed, time_s, rows.segment)
    if jitter:
        before, after = (
            _accelerations(v, time_s, rows) for v in (derivative(points, time_s, rows.segment), velocity)
        )
        found.append(
            f"positions jitter by {noise:.2f} m: smoothed (1st to 99th percentile of the acceleration "
            f"{before} -> {after} m/s²)"
        )
    points = np.where(chosen[:, None], smoothed, points)
    return (
        rows.with_columns(
            x=points[:, 0],
            y=points[:, 1],
            vx=np.where(chosen, velocity[:, 0], rows.vx),
            vy=np.where(chosen, velocity[:, 1], rows.vy),
        ),
        found,
    )


def _accelerations(velocity: FloatArray, time_s: FloatArray, rows: TrackRows) -> str:
    joined = np.diff(rows.segment) == 0
    change = np.diff(np.hypot(*velocity.T))[joined] / np.diff(time_s)[joined]
    low, high = np.percentile(change, (1.0, 99.0))
    return f"{low:.1f}..{high:.1f}"


def _contradictions(
    rows: TrackRows, points: FloatArray, time_s: FloatArray
) -> tuple[BoolArray, BoolArray, FloatArray]:
    """Compare displacements over up to one second with the integral of the velocities."""
    reach = max(1, round(1.0 / max(float(np.median(np.diff(time_s)[np.diff(rows.segment) == 0])), 1e-3)))
    velocity = np.stack((rows.vx, rows.vy), axis=1)
    area = (velocity[1:] + velocity[:-1]) / 2.0 * np.diff(time_s)[:, None]
    area[np.diff(rows.segment) != 0] = 0.0
    integral = np.vstack((np.zeros((1, 2)), np.cumsum(area, axis=0)))
    last = np.append(np.flatnonzero(np.diff(rows.segment) != 0), len(rows) - 1)
    end_of = last[np.searchsorted(last, np.arange(len(rows)))]
    ahead = np.minimum(np.arange(len(rows)) + reach, end_of)
    moved, said = points[ahead] - points, integral[ahead] - integral
    weight = 1.0 / reach  # windows overlap reach-fold
    tracks = rows.tracks
    dd = np.bincount(rows.track, np.sum(moved**2, axis=1), tracks)
    vv = np.bincount(rows.track, np.sum(said**2, axis=1), tracks)
    dv = np.bincount(rows.track, np.sum(moved * said, axis=1), tracks)
    path = np.bincount(rows.track, np.hypot(*moved.T), tracks) * weight
    said_path = np.bincount(rows.track, np.hypot(*said.T), tracks) * weight
    judged = np.maximum(path, said_path) > JUDGED_PATH_M
    cosine = dv / np.sqrt(np.maximum(dd * vv, 1e-12))
    factor = np.where(cosine < VELOCITY_COSINE, 0.0, dv / np.maximum(vv, 1e-12))
    wrong = judged & ((factor > VELOCITY_RATIO) | (factor < 1.0 / VELOCITY_RATIO))
    return judged, wrong, factor


def _how_wrong(factor: FloatArray) -> str:
    scaled = factor[factor > 0.0]
    words = []
    if len(scaled):
        ratio = float(np.median(scaled))
        words.append(f"{ratio:.2f} x too small" if ratio > 1.0 else f"{1.0 / ratio:.2f} x too large")
    if len(scaled) < len(factor):
        count = "" if not len(scaled) else f"{len(factor) - len(scaled)} in the "
        words.append(f"{count}wrong direction")
    return ", ".join(words)


def _drop_implausible(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    size: BoolArray = (np.maximum(rows.length / MAX_LENGTH_M, rows.width / MAX_WIDTH_M) > 1.0) | (
        np.minimum(rows.length, rows.width) < MIN_SIZE_M
    )
    wrong_size = np.bincount(rows.track, size, rows.tracks) > 0
    too_fast = (np.bincount(rows.track, rows.speed > MAX_SPEED_MPS, rows.tracks) > 0) & ~wrong_size
    found = []
    sizes = f"longer than {MAX_LENGTH_M:g} m, wider than {MAX_WIDTH_M:g} m or under {MIN_SIZE_M:g} m"
    for wrong, what in ((wrong_size, sizes), (too_fast, f"faster than {MAX_SPEED_MPS:g} m/s")):
        if wrong.any():
            labels = [rows.labels[k] for k in np.flatnonzero(wrong)]
            found.append(f"tracks {what} left out: {listed(labels)}")
    return (rows.take(~(wrong_size | too_fast)[rows.track]) if found else rows), found


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
    return _numbered_again(rows.take(keep)), found


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


TRACKS = Repair(tracks=repair_tracks)
