"""States of recorded tracks on the steps of a seed scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.converters.tracks_heading import wrap
from scex_sumo.converters.tracks_moments import STAMP_MS, segment_spans
from scex_sumo.converters.tracks_rows import TrackRows
from scex_sumo.scene import BoolArray, FloatArray, IntArray, States


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """The n road users present at a moment, on a grid of steps.

    Attributes:
        track: (n,) index into the rows' labels.
        length: (n,) m, median of the track.
        width: (n,) m, median of the track.
        states: (n, T) at every step; at constant velocity before and after what is recorded.
        recorded: (n, T) True within the recorded piece of the track.
        interpolated: steps without a sample of their own within the recorded pieces.
    """

    track: IntArray
    length: FloatArray
    width: FloatArray
    states: States
    recorded: BoolArray
    interpolated: int


def sample(rows: TrackRows, moment_ms: float, grid_ms: FloatArray) -> Sampled:
    """Sample everyone who is there at a moment, sorted as the rows are.

    Samples within a rounded millisecond of a step are taken as they are; between samples positions follow
    the cubic through both positions and velocities, headings turn the shorter way.

    Args:
        rows: of one case.
        moment_ms: the moment.
        grid_ms: (T,) rising.
    """
    states: list[States] = []
    recorded: list[BoolArray] = []
    tracks: list[int] = []
    sizes: list[tuple[float, float]] = []
    holes = 0
    if len(rows):
        first, last = segment_spans(rows.segment, rows.timestamp_ms)
        there = (first <= moment_ms + STAMP_MS) & (last >= moment_ms - STAMP_MS)
        for number in np.unique(rows.segment[there]):
            piece = rows.take(rows.segment == number)
            known = (grid_ms >= piece.timestamp_ms[0] - STAMP_MS) & (
                grid_ms <= piece.timestamp_ms[-1] + STAMP_MS
            )
            on_track, exact = _interpolate(piece, grid_ms)
            states.append(_extend(on_track, known, grid_ms / 1000.0))
            recorded.append(known)
            holes += int((known & ~exact).sum())
            track = int(rows.track[np.argmax(rows.segment == number)])
            whole = rows.track == track
            tracks.append(track)
            sizes.append((float(np.median(rows.length[whole])), float(np.median(rows.width[whole]))))
    shape = (0, len(grid_ms))
    return Sampled(
        track=np.array(tracks, np.int64),
        length=np.array([size[0] for size in sizes], np.float64),
        width=np.array([size[1] for size in sizes], np.float64),
        states=States.stack(states, 0) if states else States.empty(shape),
        recorded=np.stack(recorded) if recorded else np.zeros(shape, bool),
        interpolated=holes,
    )


def _interpolate(piece: TrackRows, grid_ms: FloatArray) -> tuple[States, BoolArray]:
    """(T,) states, held at the ends, and where a sample of its own exists."""
    stamps = piece.timestamp_ms
    right = np.clip(np.searchsorted(stamps, grid_ms), 0, len(stamps) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(stamps[left] - grid_ms) < np.abs(stamps[right] - grid_ms), left, right)
    outside = (grid_ms <= stamps[0]) | (grid_ms >= stamps[-1])
    exact = np.abs(stamps[nearest] - grid_ms) <= STAMP_MS
    alone = exact | outside
    i = np.where(alone, nearest, left)
    j = np.where(alone, nearest, right)
    span = np.where(i == j, 1.0, (stamps[j] - stamps[i]) / 1000.0)
    u = np.where(i == j, 0.0, (grid_ms - stamps[i]) / 1000.0 / span)
    speed = np.hypot(
        piece.vx[i] + u * (piece.vx[j] - piece.vx[i]), piece.vy[i] + u * (piece.vy[j] - piece.vy[i])
    )
    heading = piece.psi_rad[i] + u * wrap(piece.psi_rad[j] - piece.psi_rad[i])
    return (
        States(
            x=_hermite(piece.x[i], piece.x[j], piece.vx[i] * span, piece.vx[j] * span, u),
            y=_hermite(piece.y[i], piece.y[j], piece.vy[i] * span, piece.vy[j] * span, u),
            heading=wrap(heading),
            speed=speed,
        ),
        exact,
    )


def _hermite(p: FloatArray, q: FloatArray, dp: FloatArray, dq: FloatArray, u: FloatArray) -> FloatArray:
    """Cubic through p and q with slopes dp and dq per unit of u."""
    bend = dp * (1.0 - u) - dq * u + (q - p) * (2.0 * u - 1.0)
    return p + u * (q - p) + u * (1.0 - u) * bend


def _extend(states: States, known: BoolArray, time_s: FloatArray) -> States:
    """Constant velocity along the heading before the first and after the last known step."""
    steps = np.flatnonzero(known)
    source = np.clip(np.arange(len(known)), steps[0], steps[-1])
    away = time_s - time_s[source]
    heading, speed = states.heading[source], states.speed[source]
    x = states.x[source] + away * speed * np.cos(heading)
    y = states.y[source] + away * speed * np.sin(heading)
    return States(
        x=np.where(known, states.x, x), y=np.where(known, states.y, y), heading=heading, speed=speed
    )
