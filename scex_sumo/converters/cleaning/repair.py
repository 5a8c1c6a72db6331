"""Repair of recordings: counts defects, and repairs those that are unambiguous."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.cleaning.motion import renew_motion, repair_headings
from scex_sumo.converters.tracks.rows import FORWARD_MPS, JUMP_M, STANDING_MPS, TrackRows, TrackTable

JUMP_EXCESS_M = 1.5  # a jump is so much longer than the usual step there
# A tracker warms up if two of a track's first five steps have the same position at a rising speed.
FROZEN_STEPS, WARM_UP_RISE_MPS = 2, 0.5
WARM_UP_S = 2.0  # dropped then
MAX_LENGTH_M, MAX_WIDTH_M = 60.0, 8.0  # trams reach 54 m
MIN_SIZE_M = 0.1
MAX_SPEED_MPS = 100.0  # 360 km/h


def repair_tracks(table: TrackTable, *, exact: bool = False) -> tuple[TrackTable, tuple[str, ...]]:
    """Repair a recording, or one case of a file of cases.

    In order: duplicates, tracker warm-up, jumps, velocities and noise, headings, implausible sizes or speeds.
    Exact recordings, from a simulation, are only cut at jumps and cleared of what is implausible.

    Returns a phrase for each kind of defect, too; the first one says what is left out.
    """
    vehicles, findings = _repair(table.vehicles, table, FORWARD_MPS, exact=exact)
    # Pedestrians and cyclists face where they go.
    others, other_findings = _repair(table.others, table, STANDING_MPS, exact=exact)
    if other_findings:
        summary = "repaired in the same way" if findings else "; ".join(other_findings)
        findings.append(f"pedestrians and cyclists: {summary}")
    rows, kept = len(table.vehicles) + len(table.others), len(vehicles) + len(others)
    if rows > kept:
        lost, tracks = table.vehicles.tracks - vehicles.tracks, table.vehicles.tracks
        of_vehicles = f"{lost} of {tracks} vehicles and " if lost else ""
        findings.insert(0, f"{of_vehicles}{rows - kept} of {rows} rows left out")
    return replace(table, vehicles=vehicles, others=others), tuple(findings)


def _repair(
    rows: TrackRows, table: TrackTable, forward_mps: float, *, exact: bool
) -> tuple[TrackRows, list[str]]:
    findings: list[str] = []
    if not len(rows):
        return rows, findings
    steps: tuple[Callable[[TrackRows], tuple[TrackRows, list[str]]], ...] = (
        _drop_duplicates,
        lambda rows: (rows, []) if table.has_cases else _drop_warm_up(rows),
        _cut_jumps,
        renew_motion,
        lambda rows: repair_headings(rows, forward_mps),
        _drop_implausible,
    )
    for step in (_cut_jumps, _drop_implausible) if exact else steps:
        rows, phrases = step(rows)
        findings += phrases
        if not len(rows):
            break
    return rows, findings


def _drop_duplicates(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    duplicate = np.append(False, (np.diff(rows.track) == 0) & (np.diff(rows.timestamp_ms) == 0))
    if not duplicate.any():
        return rows, []
    from scex_sumo.converters.cleaning.samples import without_duplicates

    return without_duplicates(rows, duplicate)


def _cut_jumps(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    jump = _jumps(rows)
    if not jump.any():
        return rows, []
    from scex_sumo.converters.cleaning.samples import without_jumps

    return without_jumps(rows, jump)


def _jumps(rows: TrackRows) -> BoolArray:
    joined: BoolArray = np.diff(rows.segment) == 0
    length = np.hypot(np.diff(rows.x), np.diff(rows.y))
    if not (joined & (length > JUMP_M)).any():
        return np.zeros(len(joined), bool)
    # No jump if another step nearby is about as long: this spares highways the search below.
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(np.where(joined, length, np.inf), 5, constant_values=np.inf), 11
    )
    far = joined & (length > JUMP_M) & (length - around.min(axis=1) > JUMP_EXCESS_M)
    elapsed = np.diff(rows.timestamp_ms) / 1000.0
    jump = np.zeros(len(length), bool)
    for i in np.flatnonzero(far):
        window = slice(max(0, i - 5), i + 6)
        within = joined[window] & (rows.segment[:-1][window] == rows.segment[i])
        usual = np.median(length[window][within] / elapsed[window][within])
        jump[i] = length[i] - usual * elapsed[i] > JUMP_EXCESS_M
    return jump


def _drop_warm_up(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Drop the start of tracks whose filter had not yet converged."""
    start, piece = rows.pieces[0], rows.piece
    since = np.arange(len(rows)) - start[piece]
    unmoved = (np.diff(rows.x) == 0.0) & (np.diff(rows.y) == 0.0) & (since[1:] > 0) & (since[1:] <= 5)
    faster = np.diff(rows.speed) > 0.0
    moving = (rows.speed[1:] + rows.speed[:-1]) / 2.0 > 0.15
    frozen = np.bincount(piece[1:][unmoved & faster & moving], minlength=piece[-1] + 1) >= FROZEN_STEPS
    age_ms = rows.timestamp_ms - rows.timestamp_ms[start][piece]
    top_speed = np.maximum.reduceat(np.where(age_ms <= 1000.0, rows.speed, 0.0), start)
    frozen &= top_speed - rows.speed[start] > WARM_UP_RISE_MPS
    if not frozen.any():
        return rows, []
    keep = ~frozen[piece] | (age_ms >= 1000.0 * WARM_UP_S)
    cold = len(np.unique(rows.track[start][frozen]))
    return rows.take(keep), [
        f"tracker warm-up: first {WARM_UP_S:g} s of {cold} of {rows.tracks} tracks dropped"
    ]


def _drop_implausible(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    large = np.maximum(rows.length / MAX_LENGTH_M, rows.width / MAX_WIDTH_M) > 1.0
    wrong = large | (np.minimum(rows.length, rows.width) < MIN_SIZE_M)
    wrong_size = np.bincount(rows.track, wrong, rows.tracks) > 0
    too_fast = (np.bincount(rows.track, rows.speed > MAX_SPEED_MPS, rows.tracks) > 0) & ~wrong_size
    phrases = []
    sizes = f"longer than {MAX_LENGTH_M:g} m, wider than {MAX_WIDTH_M:g} m or under {MIN_SIZE_M:g} m"
    for of_tracks, reason in ((wrong_size, sizes), (too_fast, f"faster than {MAX_SPEED_MPS:g} m/s")):
        if of_tracks.any():
            labels = [rows.labels[k] for k in np.flatnonzero(of_tracks)]
            phrases.append(f"tracks {reason} left out: {listed(labels)}")
    return (rows.take(~(wrong_size | too_fast)[rows.track]) if phrases else rows), phrases
