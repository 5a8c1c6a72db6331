"""Motion of people: a wanted velocity, a place to wait at before the way of a vehicle, and a leader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.models.idm import IdmParameters, leader_share
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, Plan, States

HORIZON_S = 3.0  # time at which wanted changes of the way are given
Bend = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Wish:
    """Wanted motion of n people over the next steps, (n, H) each."""

    speed: FloatArray  # m/s
    heading: FloatArray  # rad


@dataclass(frozen=True, kw_only=True, eq=False)
class Behind:
    """What n people follow: gap now, m, inf without, and its speed, m/s, (n,) each."""

    gap: FloatArray
    speed: FloatArray
    idm: IdmParameters

    def acceleration(self, step: int, v: FloatArray, way: FloatArray) -> FloatArray:
        """Return (n,) accelerations, m/s²; inf without a leader."""
        gap = self.gap + self.speed * (step * STEP_S) - way
        slowing = self.idm.max_acceleration * (1 - leader_share(self.idm, v, gap, self.speed))
        return np.where(np.isfinite(gap), np.maximum(slowing, -self.idm.max_deceleration), np.inf)


def walked(
    now: States,
    wish: Wish,
    *,
    wait_m: FloatArray,
    acceleration: float,
    braking: float,
    bend: Bend | None = None,
    behind: Behind | None = None,
) -> Plan:
    """Walk n people as they wish, and let them stop at the place where they wait.

    Args:
        now: (n,).
        wait_m: (n,) way to that place; inf: they need not wait.
        acceleration: of speeding up, and slowing down at ease, m/s².
        braking: limit of stopping before that place, m/s².
        bend: turns after further ways, beside the wanted ones.
        behind: what they follow.
    """
    speed, way = np.maximum(now.speed, 0.0), np.zeros_like(now.speed)
    out = np.empty((4, PLAN_STEPS, len(speed)))
    x, y = now.x, now.y
    for step in range(PLAN_STEPS):
        eased = np.clip(wish.speed[:, step] - speed, -acceleration * STEP_S, acceleration * STEP_S)
        if behind is not None:
            eased = np.minimum(eased, behind.acceleration(step, speed, way) * STEP_S)
        left = np.maximum(wait_m - way, 0.0)
        needed = np.where(left > 0, speed**2 / (2 * np.maximum(left, 1e-6)), np.inf)
        slower = speed - np.minimum(needed, braking) * STEP_S
        held = np.isfinite(wait_m) & (needed >= 0.5 * acceleration)
        following = np.maximum(np.where(held, np.minimum(slower, speed + eased), speed + eased), 0.0)
        moved = (speed + following) * (STEP_S / 2)
        heading = wish.heading[:, step]
        if bend is not None:
            heading = heading + bend(way + moved / 2)
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


def towards(
    speed: FloatArray, direction: FloatArray, beyond: FloatArray, time_s: FloatArray, settle_s: float
) -> Wish:
    """Return the wish (n, H) that is a way beyond constant velocity (n, 2), along and across, after 3 s.

    Args:
        time_s: (H,) since the seed scene; later than 3 s the velocity stays.
        settle_s: time constant of the change of velocity.
    """
    whole = HORIZON_S + settle_s * np.expm1(-HORIZON_S / settle_s)
    share = -np.expm1(-np.minimum(time_s, HORIZON_S) / settle_s) / whole
    along, across = speed[:, None] + beyond[:, :1] * share, beyond[:, 1:] * share
    return Wish(speed=np.hypot(along, across), heading=direction[:, None] + np.arctan2(across, along))
