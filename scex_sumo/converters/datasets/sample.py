"""Sampling of recorded tracks on the steps of a seed scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.datasets.moment import STAMP_MS
from scex_sumo.converters.tracks.rows import TrackRows, ahead_speed
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """The n road users present at a moment, on a grid of T steps; sizes are medians of the track.

    Attributes:
        track: (n,) index into the rows' labels.
        states: (n, T); at constant velocity before and after what is recorded.
        recorded: (n, T) True within the recorded piece of the track.
        interpolated: number of steps without a sample of their own.
    """

    track: IntArray
    length: FloatArray
    width: FloatArray
    states: States
    recorded: BoolArray
    interpolated: int


def sample_tracks(rows: TrackRows, moment_ms: float, grid_ms: FloatArray) -> Sampled:
    """Sample the road users of one case present at a moment, in the order of the rows.

    A sample within 0.6 ms of a step is taken unchanged; others follow a cubic through positions and
    velocities.
    """
    begin, end = rows.pieces
    stamps = rows.timestamp_ms
    present = (stamps[begin] <= moment_ms + STAMP_MS) & (stamps[end] >= moment_ms - STAMP_MS)
    first, last = begin[present][:, None], end[present][:, None]
    recorded = (grid_ms >= stamps[first] - STAMP_MS) & (grid_ms <= stamps[last] + STAMP_MS)
    at, _, exact = interpolated(rows, first, last, np.broadcast_to(grid_ms, recorded.shape))
    speed = ahead_speed(at["vx"], at["vy"], at["psi_rad"])
    states = States(x=at["x"], y=at["y"], heading=at["psi_rad"], speed=speed)
    track = rows.track[begin[present]]
    tracks = [slice(*np.searchsorted(rows.track, (number, number + 1))) for number in track]
    return Sampled(
        track=track,
        length=np.array([np.median(rows.length[part]) for part in tracks], np.float64),
        width=np.array([np.median(rows.width[part]) for part in tracks], np.float64),
        states=_extend(states, recorded, grid_ms / 1000.0),
        recorded=recorded,
        interpolated=int((recorded & ~exact).sum()),
    )


def interpolated(
    rows: TrackRows, first: IntArray, last: IntArray, time_ms: FloatArray
) -> tuple[dict[str, FloatArray], IntArray, BoolArray]:
    """Return pieces of tracks, from row ``first`` to ``last``, at times: a cubic between two samples.

    Returns the columns of the motion, the row of the nearest sample, and whether it is at the time.
    """
    stamps = rows.timestamp_ms
    right = np.clip(_search(rows, first, time_ms), first, last)
    left = np.maximum(right - 1, first)
    nearest = np.where(np.abs(stamps[left] - time_ms) < np.abs(stamps[right] - time_ms), left, right)
    outside = (time_ms <= stamps[first]) | (time_ms >= stamps[last])
    exact = np.abs(stamps[nearest] - time_ms) <= STAMP_MS
    alone = exact | outside
    i = np.where(alone, nearest, left)
    j = np.where(alone, nearest, right)
    span = np.where(i == j, 1.0, (stamps[j] - stamps[i]) / 1000.0)
    u = np.where(i == j, 0.0, (time_ms - stamps[i]) / 1000.0 / span)
    columns = {
        "x": _hermite(rows.x[i], rows.x[j], rows.vx[i] * span, rows.vx[j] * span, u),
        "y": _hermite(rows.y[i], rows.y[j], rows.vy[i] * span, rows.vy[j] * span, u),
        "vx": rows.vx[i] + u * (rows.vx[j] - rows.vx[i]),
        "vy": rows.vy[i] + u * (rows.vy[j] - rows.vy[i]),
        "psi_rad": wrap(rows.psi_rad[i] + u * wrap(rows.psi_rad[j] - rows.psi_rad[i])),
    }
    return columns, nearest, exact


def _search(rows: TrackRows, first: IntArray, time_ms: FloatArray) -> IntArray:
    if not len(rows):
        return np.zeros(np.broadcast_shapes(first.shape, time_ms.shape), np.int64)
    start = rows.timestamp_ms.min() - 1e6
    length = rows.timestamp_ms.max() + 1e6 - start
    axis = rows.timestamp_ms - start + length * rows.piece
    wanted = np.clip(time_ms - start, 0.0, length) + length * rows.piece[first]
    return np.asarray(np.searchsorted(axis, wanted), np.int64)


def _hermite(p: FloatArray, q: FloatArray, dp: FloatArray, dq: FloatArray, u: FloatArray) -> FloatArray:
    bend = dp * (1.0 - u) - dq * u + (q - p) * (2.0 * u - 1.0)
    return p + u * (q - p) + u * (1.0 - u) * bend


def _extend(states: States, recorded: BoolArray, time_s: FloatArray) -> States:
    steps = np.arange(recorded.shape[1])
    first = np.argmax(recorded, axis=1)[:, None]
    last = recorded.shape[1] - 1 - np.argmax(recorded[:, ::-1], axis=1)[:, None]
    source = np.clip(steps, first, last)
    away = time_s - time_s[source]
    heading, speed = (np.take_along_axis(a, source, axis=1) for a in (states.heading, states.speed))
    x = np.take_along_axis(states.x, source, axis=1) + away * speed * np.cos(heading)
    y = np.take_along_axis(states.y, source, axis=1) + away * speed * np.sin(heading)
    return States(
        x=np.where(recorded, states.x, x), y=np.where(recorded, states.y, y), heading=heading, speed=speed
    )
