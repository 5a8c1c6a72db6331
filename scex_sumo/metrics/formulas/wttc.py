"""Worst time to collision (WTTC): both vehicles may accelerate in any direction.

The reach of a vehicle grows by half the largest acceleration times t². WTTC is the first t at which the
distance of two vehicles that keep their velocities is ½ A t², with the sum A of both accelerations. A vehicle
is a disc through its corners or, for WTTC of outlines, a rectangle that keeps its heading. The distance is
convex in t, so the time at which its tangent meets the parabola is never late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.geometry.rectangles import separated
from scex_sumo.metrics.base import MAX_ACCELERATION
from scex_sumo.metrics.formulas.distance import MARGIN, OutlinePairs, in_chunks, outline_pairs
from scex_sumo.metrics.pairs.near import least_of_near
from scex_sumo.metrics.pairs.scenes import PairValues, Samples, Scenes

MAX_ITERATIONS = 100  # a double root converges by one bit per iteration; anything else within about ten
TOLERANCE_S = 1e-12
CHUNK = 1 << 14  # discs at a time: fits the processor's cache

P = TypeVar("P", bound=Rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Discs(Rows):
    """N pairs of discs in motion; metres, seconds, second vehicle minus first."""

    dx: FloatArray
    dy: FloatArray
    dvx: FloatArray
    dvy: FloatArray
    radius: FloatArray  # sum of both


def worst_time_to_collision(*, acceleration: FloatArray, **discs: FloatArray) -> FloatArray:
    """Compute the smallest t >= 0 with ||dp + dv t|| <= radius + acceleration t² / 2, (N,) s; 0 on overlap.

    inf only where the acceleration is 0 and the vehicles never touch. Source: Wachenfeld et al. 2016.

    Args:
        acceleration: sum of both vehicles, m/s².
        discs: (N,) ``dx``, ``dy`` (m), ``dvx``, ``dvy`` (m/s), and ``radius``, the sum of both (m).
    """
    return _first_touch(_Discs(**discs), _distance_of_discs, acceleration)


def _distance_of_discs(pairs: _Discs, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = pairs.dx + pairs.dvx * time, pairs.dy + pairs.dvy * time
    centres = np.sqrt(x * x + y * y)
    slope = (x * pairs.dvx + y * pairs.dvy) / np.where(centres > 0, centres, 1.0)
    return centres - pairs.radius, slope


def _first_touch(
    pairs: P, distance_at: Callable[[P, FloatArray], tuple[FloatArray, FloatArray]], acceleration: FloatArray
) -> FloatArray:
    """Return the smallest t >= 0 at which pairs are no farther apart than ½ A t², (N,) s.

    Args:
        distance_at: returns distances (N,) of pairs at times, m, and their derivatives, m/s.
    """
    time = np.zeros(acceleration.shape)
    active = np.arange(time.size)
    for _ in range(MAX_ITERATIONS):
        distance, slope = distance_at(pairs, time[active])
        now, limit = time[active], acceleration[active]
        spare = distance - 0.5 * limit * now * now
        step = _tangent_meets_parabola(spare, slope - limit * now, limit)
        going = (distance > 0) & (spare > 0) & (step > TOLERANCE_S)
        time[active] = np.where(going, now + step, now)
        keep = np.flatnonzero(going & np.isfinite(step))
        if keep.size == 0:
            break
        if keep.size < active.size:
            active, pairs = active[keep], pairs.take(keep)
    return time


def wttc(scenes: Scenes) -> Samples:
    """Compute the WTTC of all pairs, s."""
    return scenes.of_some_pairs(_disc_times)


def _disc_times(scenes: Scenes, pair: IntArray, scene: IntArray) -> FloatArray:
    def of_chunk(pair: IntArray, scene: IntArray) -> FloatArray:
        pairs = outline_pairs(scenes, pair, scene)
        return worst_time_to_collision(
            dx=pairs.dx,
            dy=pairs.dy,
            dvx=pairs.dvx,
            dvy=pairs.dvy,
            radius=np.hypot(*pairs.own) + np.hypot(*pairs.other),
            acceleration=np.full(pair.shape, 2 * MAX_ACCELERATION),
        )

    return in_chunks(pair, scene, of_chunk)


def least_wttc(scenes: Scenes) -> Samples:
    """Compute the WTTC of the pairs that can have the shortest one of their scene, s."""
    return least_of_near(scenes, partial(_shortest, bounds=_disc_bounds, times=_disc_times), _within(scenes))


def _within(scenes: Scenes) -> Callable[[float], float]:
    """Return the distance that two vehicles can close in a time, m by s."""
    limit = 2 * MAX_ACCELERATION
    closing = 2 * np.abs(scenes.speed).max(initial=0.0)
    return lambda time_s: float(closing * time_s + limit * time_s * time_s / 2)


def _disc_bounds(scenes: Scenes) -> FloatArray:
    radius = np.hypot(scenes.length / 2, scenes.width / 2)
    vx, vy = scenes.speed * scenes.cos, scenes.speed * scenes.sin

    def approach(pairs: slice) -> tuple[FloatArray, FloatArray]:
        first, second = (side[pairs] for side in scenes.pairs)
        dx, dy, distance = scenes.dx[pairs], scenes.dy[pairs], scenes.distance[pairs]
        closing = dx * (vx[second] - vx[first]) + dy * (vy[second] - vy[first])
        return distance - (radius[first] + radius[second]), closing / np.where(distance > 0, distance, 1.0)

    return _bounds(scenes, approach)


def _bounds(scenes: Scenes, approach: Callable[[slice], tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return (P, C, T) lower bounds of the WTTC, s, computed for some pairs at a time.

    ``approach``: returns lower bounds (p, C, T) of the distance of pairs, m, and of its derivative, m/s.
    """
    table, size = np.empty(scenes.dx.shape), max(CHUNK // max(scenes.count, 1), 1)
    for start in range(0, len(table), size):
        pairs = slice(start, start + size)
        distance, slope = approach(pairs)
        least = _tangent_meets_parabola(np.maximum(distance, 0.0), slope, 2 * MAX_ACCELERATION)
        table[pairs] = np.where(scenes.both_present[pairs], np.where(distance > 0, least, 0.0), np.inf)
    return table


def _distance_of_outlines(pairs: OutlinePairs, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    cos_1, sin_1, cos_2, sin_2 = pairs.cos_1, pairs.sin_1, pairs.cos_2, pairs.sin_2
    dx, dy = pairs.dx + pairs.dvx * time, pairs.dy + pairs.dvy * time
    cos, sin = cos_1 * cos_2 + sin_1 * sin_2, cos_1 * sin_2 - sin_1 * cos_2
    x_1, y_1 = dx * cos_1 + dy * sin_1, dy * cos_1 - dx * sin_1
    x_2, y_2 = dx * cos_2 + dy * sin_2, dy * cos_2 - dx * sin_2
    own, other = pairs.own, pairs.other
    square_1, ax, ay = _corner_to_box(x_1, y_1, cos, sin, *other, *own)
    square_2, bx, by = _corner_to_box(x_2, y_2, cos, -sin, *own, *other)
    apart = separated(x_1, y_1, cos, sin, *other, *own) | separated(x_2, y_2, cos, sin, *own, *other)
    from_1 = square_1 <= square_2
    # from the first outline to the second one, in the map's frame
    wx = np.where(from_1, ax * cos_1 - ay * sin_1, bx * cos_2 - by * sin_2)
    wy = np.where(from_1, ax * sin_1 + ay * cos_1, bx * sin_2 + by * cos_2)
    distance = np.where(apart, np.sqrt(np.minimum(square_1, square_2)), 0.0)
    safe = np.where(distance > 0, distance, 1.0)
    slope = np.where(distance > 0, (wx * pairs.dvx + wy * pairs.dvy) / safe, 0.0)
    return distance, slope


def _corner_to_box(
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    half_length: FloatArray,
    half_width: FloatArray,
    box_length: FloatArray,
    box_width: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    along, across = (half_length * cos, half_length * sin), (-half_width * sin, half_width * cos)
    best = np.full(np.shape(x), np.inf)
    vector_x, vector_y = np.zeros(np.shape(x)), np.zeros(np.shape(x))
    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        px, py = x + a * along[0] + b * across[0], y + a * along[1] + b * across[1]
        px -= np.clip(px, -box_length, box_length)
        py -= np.clip(py, -box_width, box_width)
        square = px * px + py * py
        nearer = square < best
        np.copyto(best, square, where=nearer)
        np.copyto(vector_x, px, where=nearer)
        np.copyto(vector_y, py, where=nearer)
    return best, vector_x, vector_y


def _tangent_meets_parabola(spare: FloatArray, slope: FloatArray, limit: FloatArray | float) -> FloatArray:
    root = np.sqrt(np.maximum(slope * slope + 2 * limit * spare, 0.0))
    closing = root - slope
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # Two forms of the same root, each free of cancellation on its side of slope = 0.
        step = np.where(slope < 0, 2 * spare / closing, (root + slope) / limit)
    return np.where((limit == 0) & (slope >= 0), np.inf, step)


def wttc_path(scenes: Scenes) -> Samples:
    """Compute the WTTC of the outlines of all pairs, s. Source: Wachenfeld et al. 2016, not with circles."""
    return scenes.of_some_pairs(_worst_times)


def _worst_times(scenes: Scenes, pair: IntArray, scene: IntArray) -> FloatArray:
    def of_chunk(pair: IntArray, scene: IntArray) -> FloatArray:
        both = np.full(pair.shape, 2 * MAX_ACCELERATION)
        return _first_touch(outline_pairs(scenes, pair, scene), _distance_of_outlines, both)

    return in_chunks(pair, scene, of_chunk)


def least_wttc_path(scenes: Scenes) -> Samples:
    """Compute the WTTC of the outlines of the pairs that can have the shortest one of their scene, s.

    Along the line of the centres, the outlines approach no faster than their extents: a lower bound.
    """
    return least_of_near(
        scenes, partial(_shortest, bounds=_outline_bounds, times=_worst_times), _within(scenes)
    )


def _shortest(scenes: Scenes, *, bounds: Callable[[Scenes], FloatArray], times: PairValues) -> Samples:
    """Return times of the pairs whose lower bound is below the time of the likeliest pair of their scene."""
    bound = scenes.of_pairs(bounds)
    if not bound.size:
        return scenes.unordered(bound)
    scene = np.arange(scenes.count)
    likely = bound.argmin(axis=0).reshape(-1)
    first = scenes.at_pairs(times, likely, scene)
    limit = np.where(scenes.both_present.any(axis=0).reshape(-1), first, -1.0)
    close: BoolArray = scenes.both_present & (bound <= limit.reshape(scenes.shape) + MARGIN)
    return scenes.of_some_pairs(times, close)


def _outline_bounds(scenes: Scenes) -> FloatArray:
    def approach(pairs: slice) -> tuple[FloatArray, FloatArray]:
        first, second = (side[pairs] for side in scenes.pairs)
        distance = scenes.distance[pairs]
        apart = np.where(distance > 0, distance, 1.0)
        nx, ny = scenes.dx[pairs] / apart, scenes.dy[pairs] / apart
        near, closing = distance.copy(), np.zeros(nx.shape)
        for side, sign in ((first, -1.0), (second, 1.0)):
            along = nx * scenes.cos[side] + ny * scenes.sin[side]
            across = ny * scenes.cos[side] - nx * scenes.sin[side]
            near -= scenes.length[side] / 2 * np.abs(along) + scenes.width[side] / 2 * np.abs(across)
            closing += sign * along * scenes.speed[side]
        return near, closing

    return _bounds(scenes, approach)
