"""Headings of vehicles that stand, flip or contradict the motion."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.converters.tracks.rows import FORWARD_MPS, STANDING_MPS, TrackRows
from scex_sumo.geometry.polylines import wrap

MOVING_MPS = 1.0  # faster than this a recorded heading can be held while standing
JITTER_RAD = np.deg2rad(10.0)
SIDEWAYS_RAD = np.deg2rad(45.0)


def repair_headings(rows: TrackRows, forward_mps: float = FORWARD_MPS) -> tuple[TrackRows, list[str]]:
    """Set headings along the motion, and hold them while a vehicle stands.

    A heading more than 45° off the course of a vehicle faster than ``forward_mps`` becomes that course. A
    standing vehicle keeps the last heading of its motion, else gets the next one.
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
    # The whole stop is held, so that a second repair changes nothing.
    unsteady = np.bincount(stretch, standing & off) > 0
    turned = unsteady[stretch]
    heading[turned] = held[turned]
    phrases = []
    if turned.any():
        tracks = len(np.unique(rows.track[turned]))
        phrases.append(f"headings of {tracks} tracks flip or jitter while standing: held")
    if sideways.any():
        tracks = len(np.unique(rows.track[sideways]))
        phrases.append(f"headings of {tracks} tracks contradict the motion: replaced by its direction")
    return rows.with_columns(psi_rad=wrap(heading)), phrases


def _held(rows: TrackRows, heading: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the headings (N,) of the last, else the next moving sample; without motion the most frequent."""
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
    bins = np.floor(np.mod(angles, 2.0 * np.pi) / (np.pi / 18.0)).astype(int) % 36
    counts = np.bincount(bins, minlength=36)
    near = counts + np.roll(counts, 1) + np.roll(counts, -1)
    best = int(np.argmax(near))
    close = (np.abs((bins - best + 18) % 36 - 18)) <= 1
    middle = angles[close]
    reference = middle[0]
    return float(reference + np.median(wrap(middle - reference)))
