"""Headings of vehicles that stand, flip or contradict the motion."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.geometry.polylines import wrap

STANDING_MPS = 0.5
"""Slower than this a vehicle stands: trackers let standing vehicles drift by so much."""
MOVING_MPS = 1.0
"""Faster than this a recorded heading is one to hold while standing."""
FORWARD_MPS = 3.0
"""Faster than this a vehicle does not drive backwards or sideways."""
JITTER_RAD = np.deg2rad(10.0)
SIDEWAYS_RAD = np.deg2rad(45.0)


def repair_headings(rows: TrackRows, forward_mps: float = FORWARD_MPS) -> tuple[TrackRows, list[str]]:
    """Headings along the motion, and held while a vehicle stands.

    A heading more than 45° off the course of a vehicle faster than ``forward_mps`` becomes that course. Where
    the heading turns by more than 10° while a vehicle stands, or is far off the one it stopped with, the
    vehicle keeps the last heading it had while moving (before it first moves: the first one; if it never
    moves: the one it has most of the time).
    """
    heading = rows.psi_rad.copy()
    course = np.arctan2(rows.vy, rows.vx)
    sideways = (rows.speed > forward_mps) & (np.abs(wrap(heading - course)) > SIDEWAYS_RAD)
    heading[sideways] = course[sideways]
    held, limit = _held(rows, heading)
    standing = rows.speed < STANDING_MPS
    starts = np.append(True, (np.diff(rows.segment) != 0) | (np.diff(standing.astype(int)) != 0))
    stretch = np.cumsum(starts) - 1
    turn = np.abs(wrap(heading - heading[starts][stretch]))
    off = (turn > JITTER_RAD) | (np.abs(wrap(heading - held)) > limit)
    # The whole stop is held, not only its worst samples: what is held once needs no second repair.
    unsteady = np.bincount(stretch, standing & off) > 0
    turned = unsteady[stretch]
    heading[turned] = held[turned]
    found = []
    if turned.any():
        tracks = len(np.unique(rows.track[turned]))
        found.append(f"headings of {tracks} standing tracks flip or jitter: held")
    if sideways.any():
        tracks = len(np.unique(rows.track[sideways]))
        found.append(f"headings of {tracks} tracks against the motion: set")
    return rows.with_columns(psi_rad=wrap(heading)), found


def _held(rows: TrackRows, heading: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) heading of the last (else next) moving sample of the segment; else the segment's usual one.

    Also (N,) how far off it a steady heading must be to be wrong: 45° off the one a vehicle stopped with,
    135° (a flip) off the one it will start with, as it may turn while starting; without either it never is.
    """
    moving = rows.speed >= MOVING_MPS
    piece = rows.piece
    begin, end = rows.pieces[0][piece], rows.pieces[1][piece] + 1
    index = np.arange(len(rows))
    last = np.maximum.accumulate(np.where(moving, index, -1))
    coming = np.minimum.accumulate(np.where(moving, index, len(rows))[::-1])[::-1]
    source = np.where(last >= begin, last, np.where(coming < end, coming, -1))
    held = heading[source]
    for number in np.unique(piece[source < 0]):
        rows_of: IntArray = np.flatnonzero(piece == number)
        held[rows_of] = _usual(heading[rows_of])
    limit = np.where(last >= begin, SIDEWAYS_RAD, np.where(source >= 0, np.pi - SIDEWAYS_RAD, np.inf))
    return held, limit


def _usual(angles: FloatArray) -> float:
    """The angle that most of the others are close to: a mean would lie between flipped ones."""
    bins = np.floor(np.mod(angles, 2.0 * np.pi) / (np.pi / 18.0)).astype(int) % 36
    counts = np.bincount(bins, minlength=36)
    near = counts + np.roll(counts, 1) + np.roll(counts, -1)
    best = int(np.argmax(near))
    close = (np.abs((bins - best + 18) % 36 - 18)) <= 1
    middle = angles[close]
    reference = middle[0]
    return float(reference + np.median(wrap(middle - reference)))
