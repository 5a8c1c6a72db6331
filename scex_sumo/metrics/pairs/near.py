"""Near pairs of a batch of futures, and extrema that are found from them alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.pairs.scenes import Following, Samples, Scenes

NEAR_M: Final = 20.0
"""Pairs whose circles are always farther apart than this are no near pairs."""
MIN_PAIRS = 500  # below, evaluating all pairs is as fast
ROUNDING = 1e-9
MIN_CLOSING_MPS = 1e-6
MAX_SHARE = 0.7  # of near pairs, above which the search for them does not pay


def surroundings(speed: FloatArray, length: FloatArray) -> FloatArray:
    """Return the distance within which a vehicle's traffic quality counts others, m."""
    radius: FloatArray = (0.36 * speed) ** 2 + length + speed
    return radius


def near_pairs(tracks: SceneTracks) -> IntArray | None:
    """Return the numbers of the near pairs; None if most are, or there are few in all.

    A pair is near if the boxes around both ways, of all futures, come within `NEAR_M` beyond both outer
    circles, or within the `surroundings` of either.
    """
    states, present = tracks.states[:, tracks.first :], tracks.present
    futures, steps, vehicles = states.shape
    one, two = np.triu_indices(vehicles, 1)
    if len(one) < MIN_PAIRS or steps < 2 or not futures:
        return None
    there = np.ones(states.shape, dtype=np.bool_) if present is None else present[:, tracks.first :]
    apart = []
    for values in (states.x, states.y):
        low = np.where(there, values, np.inf).min(axis=(0, 1))
        high = np.where(there, values, -np.inf).max(axis=(0, 1))
        apart.append(np.maximum(np.maximum(low[two] - high[one], low[one] - high[two]), 0.0))
    length, width = (np.atleast_2d(size).max(axis=0) for size in (tracks.length, tracks.width))
    circle = np.hypot(length, width) / 2
    seen = np.where(there, surroundings(states.speed, length), 0.0).max(axis=(0, 1))
    reach = np.maximum(NEAR_M + circle[one] + circle[two], np.maximum(seen[one], seen[two]))
    near = np.flatnonzero(np.hypot(*apart) <= reach)
    return near if len(near) < MAX_SHARE * len(one) else None


def least_of_near(scenes: Scenes, values: Callable[[Scenes], Samples], beyond: float) -> Samples:
    """Return values of the near pairs if these have the smallest value of each scene; else of all pairs.

    Args:
        beyond: no value of another pair is smaller.
    """
    if scenes.near is not None:
        found = values(scenes.near.scenes.under(scenes.preset))
        least = np.where(found.defined, found.value, np.inf).min(axis=0, initial=np.inf)
        if (least < beyond * (1 - ROUNDING)).all():
            return found
    return values(scenes)


def soonest_following(scenes: Scenes) -> Following:
    """Find those pairs of `leaders_by_heading` that can have the least TTC or PTTC of their scene.

    These are the near pairs, and the others in scenes where no near pair is as soon as these can be.
    """
    if scenes.near is None:
        return scenes.following
    near = scenes.near.scenes.under(scenes.preset)
    rows, pairs, count = near.following, len(scenes.pairs[0]), scenes.count
    closing = rows.follower_speed - rows.leader_speed
    soon, fastest = np.zeros(count, dtype=bool), scenes.speed.max(initial=0.0) - scenes.speed.min(initial=0.0)
    is_soon = (closing > MIN_CLOSING_MPS) & (rows.gap * fastest < NEAR_M * (1 - ROUNDING) * closing)
    soon[rows.where[is_soon] % count] = True
    far, late = np.setdiff1d(np.arange(pairs), scenes.near.pair), np.flatnonzero(~soon)
    some = scenes.of_scenes(late, far)
    parts = []
    for found, pair, scene in ((rows, scenes.near.pair, np.arange(count)), (some.following, far, late)):
        number, at = np.divmod(found.where, max(len(scene), 1))
        parts.append(replace(found, where=np.concatenate([pair, pair + pairs])[number] * count + scene[at]))
    return Following.join(parts)
