"""Motion in recordings: the noise of positions, and velocities that contradict them."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows

JUMP_M = 3.0  # a shorter step is no jump
# Velocities contradict the motion if their integral is off by more than this factor, or points elsewhere.
VELOCITY_RATIO, VELOCITY_COSINE = 1.2, 0.9
JUDGED_PATH_M = 3.0  # least summed displacement of a judged track
NOISE_M = 0.02  # positions with more white noise than this per axis are smoothed


def renew_motion(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Smooth positions that jitter, and recompute velocities that contradict them; a phrase for each."""
    if not (np.diff(rows.segment) == 0).any():
        return rows, []
    time_s = rows.timestamp_ms / 1000.0
    points = np.stack((rows.x, rows.y), axis=1)
    judged, wrong, factor = _contradictions(rows, points, time_s)
    noise = position_noise(points, time_s, rows.segment)
    jitter = noise > NOISE_M
    everything = jitter or 2 * wrong.sum() > judged.sum()
    if not everything and not wrong.any():
        return rows, []
    from scex_sumo.converters.cleaning.smooth import smoothed_motion

    phrases = []
    if wrong.any():
        phrases.append(
            f"velocities of {int(wrong.sum())} of {int(judged.sum())} moving tracks contradict the motion"
            f" ({_how_wrong(factor[wrong])}): recomputed from positions"
        )
    chosen = np.full(len(rows), True) if everything else wrong[rows.track]
    rows, phrase = smoothed_motion(rows, noise, chosen)
    return rows, [*phrases, *([phrase] if jitter else [])]


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


def position_noise(points: FloatArray, time_s: FloatArray, segment: IntArray) -> float:
    """Estimate the standard deviation of white noise in the positions of moving tracks, per axis in m.

    The variance of third differences is 20 times that of white noise. The largest 2 % are left out as jumps.
    0 with too few samples.

    Args:
        segment: (N,) number of the piece of a track, rows in order of time.
    """
    if len(points) < 4:
        return 0.0
    step = np.diff(time_s)
    even = np.abs(step - np.median(step)) < 0.1 * np.median(step)
    inside = (segment[3:] == segment[:-3]) & even[2:] & even[1:-1] & even[:-2]
    moved = np.hypot(*(points[3:] - points[:-3]).T) > 1.0 * (time_s[3:] - time_s[:-3])
    third = np.diff(points, n=3, axis=0)[inside & moved]
    if len(third) < 10:
        return 0.0
    power = np.sort(np.sum(third**2, axis=1))
    return float(np.sqrt(np.mean(power[: max(1, int(0.98 * len(power)))]) / 40.0))
