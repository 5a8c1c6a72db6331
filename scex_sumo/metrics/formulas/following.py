"""Metrics of car-following pairs: TTC, PTTC, time headway (THW), DRAC; undefined for other pairs."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.base import STANDING_MPS
from scex_sumo.metrics.pairs.leaders import leaders_by_heading, leaders_on_path
from scex_sumo.metrics.pairs.scenes import Entries, Following, Scenes

MIN_CLOSING_MPS = 1e-9


def time_to_collision(*, gap: FloatArray, closing_speed: FloatArray) -> FloatArray:
    """Compute the time until the follower has used up the gap at present speeds; (N,) m, m/s, s.

    inf where the gap does not close by at least 1e-9 m/s, which is rounding. Source: Tamke et al. 2011.
    """
    closing = closing_speed >= MIN_CLOSING_MPS
    time = np.full(np.broadcast(gap, closing_speed).shape, np.inf)
    with np.errstate(over="ignore"):  # a vanishing closing speed is an infinite time
        np.divide(gap, closing_speed, out=time, where=closing)
    return time


def ttc(scenes: Scenes) -> Entries:
    """Compute the TTC of all pairs that follow by heading, s."""
    return _ttc_of(scenes.once(leaders_by_heading))


def ttc_path(scenes: Scenes) -> Entries:
    """Compute the TTC of all pairs that follow along a planned path, s."""
    return _ttc_of(scenes.once(leaders_on_path))


def _ttc_of(pairs: Following) -> Entries:
    time = time_to_collision(gap=pairs.gap, closing_speed=pairs.follower_speed - pairs.leader_speed)
    return Entries(where=pairs.where, value=time)


def potential_time_to_collision(
    *, gap: FloatArray, follower_speed: FloatArray, leader_speed: FloatArray, leader_acceleration: FloatArray
) -> FloatArray:
    """Compute the time until the follower, at constant speed, reaches a leader that brakes to a stop.

    With the closing speed c and the leader's deceleration D: the smaller root of d = c t + D t² / 2 if the
    leader still moves then, else the time to the stopped leader. Without braking it is the TTC.

    Args:
        gap: (N,) m, at least 0.
        follower_speed: (N,) m/s.
        leader_speed: (N,) m/s.
        leader_acceleration: (N,) m/s², negative while braking.

    Returns:
        (N,) s; inf where the follower never arrives.

    Source: Wakabayashi et al. 2003.
    """
    closing = follower_speed - leader_speed
    time = time_to_collision(gap=gap, closing_speed=closing)
    # A reversing leader with a negative acceleration is not braking. Denormal products are 0.
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
    """Compute the PTTC of all pairs that follow by heading, s."""
    return _pttc_of(scenes.once(leaders_by_heading))


def pttc_path(scenes: Scenes) -> Entries:
    """Compute the PTTC of all pairs that follow along a planned path, s."""
    return _pttc_of(scenes.once(leaders_on_path))


def _pttc_of(pairs: Following) -> Entries:
    time = potential_time_to_collision(
        gap=pairs.gap,
        follower_speed=pairs.follower_speed,
        leader_speed=pairs.leader_speed,
        leader_acceleration=pairs.leader_acceleration,
    )
    return Entries(where=pairs.where, value=time)


def thw(scenes: Scenes) -> Entries:
    """Compute the time in which each follower along a path reaches the leader's present position, s.

    Undefined for standing followers. Source: Westhofen et al. 2021 (review).
    """
    pairs = scenes.once(leaders_on_path)
    moving = pairs.follower_speed > STANDING_MPS
    return Entries(where=pairs.where[moving], value=pairs.gap[moving] / pairs.follower_speed[moving])


def deceleration_to_avoid_crash(*, gap: FloatArray, closing_speed: FloatArray) -> FloatArray:
    """Compute the deceleration to the leader's speed within the gap, c² / (2 d), (N,) m/s².

    0 where the gap does not close, inf without a gap. Source: Cooper and Ferguson 1976.
    """
    closing = np.maximum(closing_speed, 0.0)
    rate = np.zeros(np.broadcast(gap, closing).shape)
    with np.errstate(divide="ignore", over="ignore"):
        np.divide(closing * closing, 2 * gap, out=rate, where=closing > 0)
    return rate


def drac(scenes: Scenes) -> Entries:
    """Compute the deceleration rate to avoid a crash (DRAC) of all pairs that follow along a path, m/s²."""
    pairs = scenes.once(leaders_on_path)
    rate = deceleration_to_avoid_crash(gap=pairs.gap, closing_speed=pairs.follower_speed - pairs.leader_speed)
    return Entries(where=pairs.where, value=rate)
