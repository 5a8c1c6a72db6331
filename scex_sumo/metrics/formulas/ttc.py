"""Time to collision of car-following pairs (TTC)."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.scenes import Scenes

NOT_CLOSING_MPS = 1e-9


def time_to_collision(*, gap: FloatArray, closing_speed: FloatArray) -> FloatArray:
    """Time until the follower has used up the gap at present speeds.

    Args:
        gap: (F,) m, at least 0.
        closing_speed: (F,) follower minus leader, m/s.

    Returns:
        (F,) s; inf where the gap opens or stays, or closes by less than 1e-9 m/s, which is rounding.

    Source: Tamke et al. 2011.
    """
    closing = closing_speed >= NOT_CLOSING_MPS
    time = np.full(np.broadcast(gap, closing_speed).shape, np.inf)
    with np.errstate(over="ignore"):  # a vanishing closing speed is an infinite time
        np.divide(gap, closing_speed, out=time, where=closing)
    return time


def ttc(scenes: Scenes) -> Entries:
    """TTC of all car-following pairs, s; undefined for the other pairs."""
    pairs = scenes.following
    time = time_to_collision(gap=pairs.gap, closing_speed=pairs.follower_speed - pairs.leader_speed)
    return Entries(where=pairs.where, value=time)
