"""Motion in recordings: noise of positions, velocities and headings that contradict them."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import FORWARD_MPS, STANDING_MPS, TrackRows
from scex_sumo.geometry.polylines import wrap

# Velocities contradict the motion if their integral is off by more than this factor, or points elsewhere.
VELOCITY_RATIO, VELOCITY_COSINE = 1.2, 0.9
JUDGED_PATH_M = 3.0  # least summed displacement of a judged track
NOISE_M = 0.02  # positions with more white noise than this per axis are smoothed
MOVING_MPS = 1.0  # faster than this a recorded heading can be held while standing
JITTER_RAD = np.deg2rad(10.0)
SIDEWAYS_RAD = np.deg2rad(45.0)


def renew_motion(rows: TrackRows) -> tuple[TrackRows, list[str]]:
    """Smooth positions that jitter, and recompute velocities that contradict them; a phrase for each."""
    if not (np.diff(rows.segment) == 0).any():
        return rows, []
    time_s, points = rows.timestamp_ms / 1000.0, np.stack((rows.x, rows.y), axis=1)
    judged, wrong, factor = _contradictions(rows, points, time_s)
    noise = position_noise(rows)
    jitter = noise > NOISE_M
    all_tracks = jitter or 2 * wrong.sum() > judged.sum()
    if not all_tracks and not wrong.any():
        return rows, []
    from scex_sumo.converters.cleaning.smoothing import derivative, smooth

    phrases = []
    if wrong.any():
        phrases.append(
            f"velocities of {int(wrong.sum())} of {int(judged.sum())} moving tracks contradict the motion"
            f" ({_how_wrong(factor[wrong])}): recomputed from positions"
        )
    phrases += [f"positions jitter by {noise:.2f} m: smoothed"] if jitter else []
    chosen = all_tracks | wrong[rows.track]
    smoothed = smooth(points, time_s, rows.segment, noise)
    vx, vy = np.where(chosen, derivative(smoothed, time_s, rows.segment).T, (rows.vx, rows.vy))
    x, y = np.where(chosen, smoothed.T, points.T)
    return rows.with_columns(x=x, y=y, vx=vx, vy=vy), phrases


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
    moved, integrated = points[ahead] - points, integral[ahead] - integral
    weight = 1.0 / reach  # windows overlap reach-fold
    track_count = rows.tracks
    dd = np.bincount(rows.track, np.sum(moved**2, axis=1), track_count)
    vv = np.bincount(rows.track, np.sum(integrated**2, axis=1), track_count)
    dv = np.bincount(rows.track, np.sum(moved * integrated, axis=1), track_count)
    path = np.bincount(rows.track, np.hypot(*moved.T), track_count) * weight
    integrated_path = np.bincount(rows.track, np.hypot(*integrated.T), track_count) * weight
    judged = np.maximum(path, integrated_path) > JUDGED_PATH_M
    cosine = dv / np.sqrt(np.maximum(dd * vv, 1e-12))
    factor = np.where(cosine < VELOCITY_COSINE, 0.0, dv / np.maximum(vv, 1e-12))
    wrong = judged & ((factor > VELOCITY_RATIO) | (factor < 1.0 / VELOCITY_RATIO))
    return judged, wrong, factor


def _how_wrong(factor: FloatArray) -> str:
    scaled = factor[factor > 0.0]
    if not len(scaled):
        return "wrong direction"
    ratio = float(np.median(scaled))
    size = f"{ratio:.2f} x too small" if ratio > 1.0 else f"{1.0 / ratio:.2f} x too large"
    turned = len(factor) - len(scaled)
    return f"{size}, {turned} in the wrong direction" if turned else size


def position_noise(rows: TrackRows) -> float:
    """Estimate the standard deviation of white noise in the positions of moving tracks, per axis in m.

    The variance of third differences is 20 times that of white noise. The largest 2 % are left out as jumps.
    0 with too few samples.
    """
    if len(rows) < 4:
        return 0.0
    points, time_s, segment = np.stack((rows.x, rows.y), axis=1), rows.timestamp_ms / 1000.0, rows.segment
    step = np.diff(time_s)
    even = np.abs(step - np.median(step)) < 0.1 * np.median(step)
    inside = (segment[3:] == segment[:-3]) & even[2:] & even[1:-1] & even[:-2]
    moved = np.hypot(*(points[3:] - points[:-3]).T) > 1.0 * (time_s[3:] - time_s[:-3])
    third = np.diff(points, n=3, axis=0)[inside & moved]
    if len(third) < 10:
        return 0.0
    power = np.sort(np.sum(third**2, axis=1))
    return float(np.sqrt(np.mean(power[: max(1, int(0.98 * len(power)))]) / 40.0))


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
    deviates = (turn > JITTER_RAD) | (np.abs(wrap(heading - held)) > limit)
    # The whole stop is held, so that a second repair changes nothing.
    unsteady = np.bincount(stretch, standing & deviates) > 0
    turned = unsteady[stretch]
    heading[turned] = held[turned]
    repairs = {
        "flip or jitter while standing: held": turned,
        "contradict the motion: replaced by its direction": sideways,
    }
    counts = {said: len(np.unique(rows.track[changed])) for said, changed in repairs.items()}
    phrases = [f"headings of {tracks} tracks {said}" for said, tracks in counts.items() if tracks]
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
