"""Motion of people: a wanted speed and direction, and a place to wait at before the way of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, Plan, States

STRAIGHT_S = 3.0  # time at which wanted changes of speed and direction are given


@dataclass(frozen=True, kw_only=True, eq=False)
class Wish:
    """Wanted motion of n people over the next steps, (n, H) each."""

    speed: FloatArray  # m/s
    heading: FloatArray  # rad


def walked(
    now: States,
    wish: Wish,
    *,
    wait_m: FloatArray,
    acceleration: float,
    braking: float,
) -> Plan:
    """Walk n people as they wish, and let them stop at the place where they wait.

    Args:
        now: (n,).
        wait_m: (n,) way to that place; inf: they need not wait.
        acceleration: of speeding up, and slowing down at ease, m/s².
        braking: limit of stopping before that place, m/s².
    """
    speed, way = np.maximum(now.speed, 0.0), np.zeros_like(now.speed)
    out = np.empty((4, PLAN_STEPS, len(speed)))
    x, y = now.x, now.y
    for step in range(PLAN_STEPS):
        eased = np.clip(wish.speed[:, step] - speed, -acceleration * STEP_S, acceleration * STEP_S)
        left = np.maximum(wait_m - way, 0.0)
        needed = np.where(left > 0, speed**2 / (2 * np.maximum(left, 1e-6)), np.inf)
        slower = speed - np.minimum(needed, braking) * STEP_S
        held = np.isfinite(wait_m) & (needed >= 0.5 * acceleration)
        following = np.maximum(np.where(held, np.minimum(slower, speed + eased), speed + eased), 0.0)
        moved = (speed + following) * (STEP_S / 2)
        heading = wish.heading[:, step]
        x, y = x + moved * np.cos(heading), y + moved * np.sin(heading)
        speed, way = following, way + moved
        out[:, step] = x, y, wrap(heading), speed
    x, y, heading, speed = np.ascontiguousarray(out.transpose(0, 2, 1))
    return Plan(x=x, y=y, heading=heading, speed=speed)


def steady(speed: FloatArray, heading: FloatArray) -> Wish:
    """Return the wish (n, H) to keep a speed and a direction (n,)."""
    return Wish(
        speed=np.repeat(speed[:, None], PLAN_STEPS, axis=1),
        heading=np.repeat(heading[:, None], PLAN_STEPS, axis=1),
    )
