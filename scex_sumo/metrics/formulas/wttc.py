"""Worst time to collision (WTTC): both vehicles may accelerate in any direction.

The reach of a vehicle is a disc through its corners that moves at the present velocity and grows by half the
largest acceleration times t². WTTC is the time at which two discs touch.
"""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

MAX_ITERATIONS = 100  # a double root converges by one bit per iteration; anything else within about ten
TOLERANCE = 4e-16
CHUNK = 1 << 14  # pairs at a time: fits the processor's cache


def worst_time_to_collision(
    *,
    dx: FloatArray,
    dy: FloatArray,
    dvx: FloatArray,
    dvy: FloatArray,
    radius: FloatArray,
    acceleration: FloatArray,
) -> FloatArray:
    """Compute the smallest t >= 0 with ||dp + dv t|| = radius + acceleration t² / 2, (N,) s; 0 on overlap.

    Radius and acceleration are sums of both vehicles; m, m/s, m/s². inf only where the acceleration is 0 and
    the vehicles never touch. Source: Wachenfeld et al. 2016.
    """
    time = np.empty(dx.shape)
    for start in range(0, len(dx), CHUNK):
        part = slice(start, start + CHUNK)
        x, y, vx, vy, reach = (values[part] for values in (dx, dy, dvx, dvy, radius))
        centres = np.sqrt(x * x + y * y)
        terms = centres - reach, centres, reach, vx * vx + vy * vy, x * vx + y * vy
        time[part] = _first_contact(*terms, acceleration[part])
    return time


def _first_contact(gap: FloatArray, *terms: FloatArray) -> FloatArray:
    time = np.zeros(gap.shape)
    apart = gap > 0
    moving = apart & (terms[-1] == 0)
    if moving.any():
        time[moving] = _without_acceleration(gap[moving], *(a[moving] for a in terms[:-1]))
        apart &= ~moving
    if apart.all():
        return _first_root(gap, *terms)
    time[apart] = _first_root(gap[apart], *(a[apart] for a in terms))
    return time


def _without_acceleration(
    gap: FloatArray, centres: FloatArray, radius: FloatArray, v2: FloatArray, pv: FloatArray
) -> FloatArray:
    c = gap * (centres + radius)
    discriminant = pv * pv - v2 * c
    meets = (pv < 0) & (discriminant >= 0)
    time = np.full(gap.shape, np.inf)
    time[meets] = c[meets] / (np.sqrt(discriminant[meets]) - pv[meets])
    return time


def _first_root(
    gap: FloatArray,
    centres: FloatArray,
    radius: FloatArray,
    v2: FloatArray,
    pv: FloatArray,
    acceleration: FloatArray,
) -> FloatArray:
    """Return the first root of q(t) = (R + A t²/2)² - ||dp + dv t||² for discs that are apart, A > 0.

    q starts negative and is concave up to an inflection, then convex. On the concave part Newton's iteration
    from the left cannot step over the first root.
    """
    a4, a2 = 0.25 * acceleration * acceleration, acceleration * radius - v2
    a1, a0 = -2 * pv, -gap * (centres + radius)
    speed = np.sqrt(v2)
    reach = speed + np.sqrt(v2 + 2 * acceleration * gap)
    time: FloatArray = 2 * gap / reach
    high = reach / acceleration
    inflection = np.sqrt(np.maximum(-a2, 0) / (6 * a4))
    concave = np.flatnonzero(time < inflection)
    has_root = np.zeros(time.shape, dtype=bool)
    if concave.size:
        root, is_root = _newton_concave(*(a[concave] for a in (a4, a2, a1, a0, time, inflection)))
        time[concave] = root
        has_root[concave] = is_root
    if not has_root.any():
        return _newton_convex(a4, a2, a1, a0, time, high)
    rest = np.flatnonzero(~has_root)
    time[rest] = _newton_convex(*(a[rest] for a in (a4, a2, a1, a0, time, high)))
    return time


def _newton_concave(
    a4: FloatArray, a2: FloatArray, a1: FloatArray, a0: FloatArray, time: FloatArray, inflection: FloatArray
) -> tuple[FloatArray, BoolArray]:
    time = time.copy()
    has_root = np.zeros(time.shape, dtype=bool)
    active = np.arange(time.size)
    for _ in range(MAX_ITERATIONS):
        t, b4, b2, b1 = time[active], a4[active], a2[active], a1[active]
        t2 = t * t
        q = ((b4 * t2 + b2) * t + b1) * t + a0[active]
        slope = (4 * b4 * t2 + 2 * b2) * t + b1
        # At or past its maximum the concave part has no root ahead.
        rising = slope > 0
        after = np.where(rising, t - q / np.where(rising, slope, 1.0), np.inf)
        none = (after > inflection[active]) & (q < 0)
        # From the left every exact step goes forward; another one is rounding, at the root.
        done = ~none & ((q >= 0) | (after - t <= TOLERANCE * t))
        time[active] = np.where(none, inflection[active], np.where(done & ~rising, t, after))
        has_root[active[done]] = True
        active = active[~(none | done)]
        if active.size == 0:
            break
    has_root[active] = True  # a double root
    return time, has_root


def _newton_convex(
    a4: FloatArray, a2: FloatArray, a1: FloatArray, a0: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    # One step from the left lands on the right of the root, mostly closer than the bound.
    q, slope = _polynomial(a4, a2, a1, a0, low)
    rising = slope > 0
    time = np.minimum(high, low - q / np.where(rising, slope, 1.0), out=high.copy(), where=rising)
    time = np.maximum(time, low)
    active: IntArray | None = None
    for iteration in range(MAX_ITERATIONS):
        t = time if active is None else time[active]
        q, slope = _polynomial(a4, a2, a1, a0, t)
        step = q / slope
        after = t - step
        if active is None:
            time = after
        else:
            time[active] = after
        if iteration < 2:
            continue
        going = np.flatnonzero(step > TOLERANCE * t)
        if going.size == 0:
            break
        active = going if active is None else active[going]
        a4, a2, a1, a0 = a4[going], a2[going], a1[going], a0[going]
    return time


def _polynomial(
    a4: FloatArray, a2: FloatArray, a1: FloatArray, a0: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    square = t * t
    high = a4 * square
    value = ((high + a2) * t + a1) * t + a0
    slope = (4 * high + 2 * a2) * t + a1
    return value, slope


def wttc(scenes: Scenes) -> Samples:
    """Compute the WTTC of all pairs, s."""
    return scenes.unordered(scenes.of_pairs(_times))


def _times(scenes: Scenes) -> FloatArray:
    first, second = scenes.pairs
    radius = np.hypot(scenes.length / 2, scenes.width / 2)
    limit = scenes.max_acceleration
    vx, vy = scenes.speed * scenes.cos, scenes.speed * scenes.sin
    shape = scenes.dx.shape
    time = worst_time_to_collision(
        dx=scenes.dx.reshape(-1),
        dy=scenes.dy.reshape(-1),
        dvx=(vx[second] - vx[first]).reshape(-1),
        dvy=(vy[second] - vy[first]).reshape(-1),
        radius=np.broadcast_to(radius[first] + radius[second], shape).reshape(-1),
        acceleration=np.broadcast_to(limit[first] + limit[second], shape).reshape(-1),
    )
    return time.reshape(shape)
