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


def near_pairs(tracks: SceneTracks) -> tuple[IntArray, FloatArray] | None:
    """Return the numbers of the near pairs, and the least distance (P,) of each pair; None if most are near.

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
    distance = np.hypot(*apart)
    near = np.flatnonzero(distance <= reach)
    return (near, distance) if len(near) < MAX_SHARE * len(one) else None


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

    These are the near pairs, and others in scenes in which they may be as soon as the soonest near pair.
    """
    if scenes.near is None:
        return scenes.following
    pairs, count, apart = len(scenes.pairs[0]), scenes.count, scenes.near.apart
    near = scenes.near.scenes.under(scenes.preset).following
    closing = near.follower_speed - near.leader_speed
    closes = closing > MIN_CLOSING_MPS
    soonest = np.full(count, np.inf)
    np.minimum.at(soonest, near.where[closes] % count, near.gap[closes] / closing[closes])
    fastest = (scenes.speed.max(initial=0.0) - scenes.speed.min(initial=0.0)) * (1 + ROUNDING)
    found = [(near, scenes.near.pair, np.arange(count))]
    far = np.ones(pairs, dtype=bool)
    far[scenes.near.pair] = False
    least = apart[far].min(initial=np.inf)
    for late in (np.isfinite(soonest) & (soonest * fastest >= least), np.isinf(soonest)):
        reach = soonest[late].max(initial=0.0)
        some = np.flatnonzero(far & ((apart <= reach * fastest) | np.isinf(reach)))
        scene = np.flatnonzero(late)
        found.append((scenes.of_scenes(scene, some).following, some, scene))
    return Following.join([_among_all(scenes, *each) for each in found])


def _among_all(scenes: Scenes, rows: Following, pair: IntArray, scene: IntArray) -> Following:
    """Return rows of some pairs in some scenes, both by number, as rows of all."""
    number, at = np.divmod(rows.where, max(len(scene), 1))
    ordered = np.concatenate([pair, pair + len(scenes.pairs[0])])
    return replace(rows, where=ordered[number] * scenes.count + scene[at])
