"""Time headway of car-following pairs (THW)."""

from __future__ import annotations

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.scenes import Scenes


def time_headway(*, gap: FloatArray, follower_speed: FloatArray) -> FloatArray:
    """Time the follower needs at present speed to where the leader is now.

    Args:
        gap: (F,) m.
        follower_speed: (F,) m/s, positive.

    Returns:
        (F,) s.

    Source: Westhofen et al. 2021 (review).
    """
    return gap / follower_speed


def thw(scenes: Scenes) -> Entries:
    """THW of all car-following pairs, s; undefined for the other pairs and for standing followers."""
    pairs = scenes.following
    moving = pairs.follower_speed > scenes.parameters.standing_speed
    time = time_headway(gap=pairs.gap[moving], follower_speed=pairs.follower_speed[moving])
    return Entries(where=pairs.where[moving], value=time)
