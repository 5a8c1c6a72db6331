"""Potential time to collision: the leader keeps braking as it does now (PTTC)."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.formulas.ttc import time_to_collision
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.scenes import Scenes


def potential_time_to_collision(
    *, gap: FloatArray, follower_speed: FloatArray, leader_speed: FloatArray, leader_acceleration: FloatArray
) -> FloatArray:
    """Time until the follower, at constant speed, reaches a leader that brakes to a stop.

    With the closing speed c and the leader's deceleration D, the smaller root of d = c t + D t² / 2 if the
    leader is still moving then, else the time the follower needs to the point where the leader stands. A
    leader that does not brake gives the TTC.

    Args:
        gap: (F,) m, at least 0.
        follower_speed: (F,) m/s.
        leader_speed: (F,) m/s.
        leader_acceleration: (F,) m/s², negative while braking.

    Returns:
        (F,) s; inf where the follower never arrives.

    Source: Wakabayashi et al. 2003.
    """
    closing = follower_speed - leader_speed
    time = time_to_collision(gap=gap, closing_speed=closing)
    # A reversing leader with a negative acceleration speeds up; it is not braking. Denormal products are 0.
    braking = np.flatnonzero((leader_acceleration < -1e-300) & (leader_speed >= 0))
    if braking.size == 0:
        return time
    deceleration, c, d = -leader_acceleration[braking], closing[braking], gap[braking]
    speed, follower = leader_speed[braking], follower_speed[braking]
    root = np.sqrt(c * c + 2 * deceleration * d)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # Two forms of the same root, each free of cancellation on its side of c = 0.
        moving = np.where(c > 0, 2 * d / (c + root), (root - c) / deceleration)
        stopped = np.where(follower > 0, (d + speed * speed / (2 * deceleration)) / follower, np.inf)
        time[braking] = np.where(moving * deceleration <= speed, moving, stopped)
    return time


def pttc(scenes: Scenes) -> Entries:
    """PTTC of all car-following pairs, s; undefined for the other pairs."""
    pairs = scenes.following
    time = potential_time_to_collision(
        gap=pairs.gap,
        follower_speed=pairs.follower_speed,
        leader_speed=pairs.leader_speed,
        leader_acceleration=pairs.leader_acceleration,
    )
    return Entries(where=pairs.where, value=time)
