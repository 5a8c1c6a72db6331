"""Deceleration rate to avoid a crash (DRAC)."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.scenes import Scenes


def deceleration_to_avoid_crash(*, gap: FloatArray, closing_speed: FloatArray) -> FloatArray:
    """Constant deceleration at which the follower has the leader's speed when the gap is used up.

    Args:
        gap: (F,) m, at least 0.
        closing_speed: (F,) follower minus leader, m/s.

    Returns:
        (F,) m/s², c² / (2 d); 0 where the gap opens or stays, inf where there is none left.

    Source: Cooper and Ferguson 1976.
    """
    closing = np.maximum(closing_speed, 0.0)
    rate = np.zeros(np.broadcast(gap, closing).shape)
    with np.errstate(divide="ignore", over="ignore"):
        np.divide(closing * closing, 2 * gap, out=rate, where=closing > 0)
    return rate


def drac(scenes: Scenes) -> Entries:
    """DRAC of all car-following pairs, m/s²; undefined for the other pairs. Larger is more critical."""
    pairs = scenes.following
    rate = deceleration_to_avoid_crash(gap=pairs.gap, closing_speed=pairs.follower_speed - pairs.leader_speed)
    return Entries(where=pairs.where, value=rate)
