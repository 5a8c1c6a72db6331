"""Which ordered pairs of a scene are car-following, and how they close in."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.metrics.pairs.entries import Following
from scex_sumo.metrics.pairs.scenes import Scenes

# Headings that differ by exactly the limit must not depend on how the scene is rotated.
ROUNDING = 1e-12


def following_by_heading(scenes: Scenes) -> Following:
    """Car-following as in the paper: similar headings, the leader ahead, no lane test.

    A pair follows where the headings differ by at most ``following_angle`` and the leader's longitudinal
    coordinate in the follower's frame is positive; the gap is the distance of the centres. Two vehicles side
    by side that turn towards each other can each be the other's leader.
    """
    return scenes.of_ordered_pairs(_alike_and_ahead)


def _alike_and_ahead(scenes: Scenes) -> Following:
    first, second = scenes.pairs
    cos, sin = scenes.cos, scenes.sin
    alignment = cos[first] * cos[second]
    alignment += sin[first] * sin[second]
    similar = alignment >= np.cos(scenes.parameters.following_angle) - ROUNDING
    similar &= scenes.both_present
    pair = np.flatnonzero(similar)
    scene_count = max(int(np.prod(scenes.shape)), 1)
    ahead = []
    for own, sign in ((first, 1.0), (second, -1.0)):
        # Flat index of the follower in (V, C, T): same scene, the pair's own vehicle.
        vehicle = own[pair // scene_count] * scene_count + pair % scene_count
        longitudinal = scenes.dx.reshape(-1)[pair] * cos.reshape(-1)[vehicle]
        longitudinal += scenes.dy.reshape(-1)[pair] * sin.reshape(-1)[vehicle]
        ahead.append(pair[sign * longitudinal > 0])
    where = np.concatenate([ahead[0], ahead[1] + similar.size])
    return gather(scenes, where, scenes.distance.reshape(-1)[np.concatenate(ahead)])


def gather(scenes: Scenes, where: IntArray, gap: FloatArray) -> Following:
    """Speeds and accelerations of pairs at flat indices of (2P, C, T)."""
    follower, leader = scenes.flat_of(where)
    speed = scenes.speed.reshape(-1)
    return Following(
        where=where,
        gap=gap,
        follower_speed=speed[follower],
        leader_speed=speed[leader],
        leader_acceleration=scenes.acceleration.reshape(-1)[leader],
    )
