"""Scheduler of rows: near pairs of a batch of futures, pairs whose ways may meet, extrema from them alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.scenes import Following, Near, Samples, Scenes, Some, TrackPairs

NEAR_M: Final = 20.0
"""Pairs whose circles are always farther apart than this are no near pairs."""
MIN_PAIRS = 500  # below, evaluating all pairs is as fast
MARGIN_M = 1.0  # for rounding
PAIR_STEPS = 1 << 21  # of far pairs at a time
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
    low, high = _extent([np.where(there, values, np.nan) for values in (states.x, states.y)])
    apart = np.maximum(np.maximum(low[:, two] - high[:, one], low[:, one] - high[:, two]), 0.0)
    length, width = (np.atleast_2d(size).max(axis=0) for size in (tracks.length, tracks.width))
    circle = np.hypot(length, width) / 2
    seen = np.where(there, surroundings(states.speed, length), 0.0).max(axis=(0, 1))
    reach = np.maximum(NEAR_M + circle[one] + circle[two], np.maximum(seen[one], seen[two]))
    distance = np.hypot(*apart)
    near = np.flatnonzero(distance <= reach)
    return (near, distance) if len(near) < MAX_SHARE * len(one) else None


def _extent(values: Sequence[FloatArray]) -> FloatArray:
    """Return (2, N, V) lowest and highest values of vehicles over (..., V); inf and -inf if all are NaN."""
    every = [value.reshape(-1, value.shape[-1]) for value in values]
    low = np.stack([np.fmin.reduce(value, axis=0, initial=np.inf) for value in every])
    return np.stack([low, [np.fmax.reduce(value, axis=0, initial=-np.inf) for value in every]])


def meeting_pairs(
    tracks: SceneTracks, planned: PlannedPaths | None, parameters: MetricParameters, near: IntArray
) -> IntArray | None:
    """Return the numbers of the near pairs and of those whose ways may meet; None if these are most.

    The way of a vehicle is in the box around all that it drives and plans. Ways may meet if the boxes do,
    with the vehicles' widths and the straight lines on which leaders are searched for.
    """
    states, present = tracks.states, tracks.present
    there = np.ones(states.shape, dtype=np.bool_) if present is None else present
    low, high = _extent([np.where(there, values, np.nan) for values in (states.x, states.y)])
    if planned is not None:
        plan = _extent([values.swapaxes(2, 3) for values in (planned.x, planned.y)])
        low, high = np.minimum(low, plan[0]), np.maximum(high, plan[1])
    speed = np.where(there, np.abs(states.speed), 0.0).max(axis=(0, 1))
    width = np.atleast_2d(tracks.width).max(axis=0)
    ahead = np.maximum(parameters.path_extension, parameters.path_extension_time * speed) + width + MARGIN_M
    one, two = np.triu_indices(states.shape[2], 1)
    apart = np.maximum(low[:, two] - high[:, one], low[:, one] - high[:, two]).max(axis=0)
    meets = apart <= np.maximum(ahead[one] + width[two], ahead[two] + width[one])
    meets[near] = True
    return np.flatnonzero(meets) if np.count_nonzero(meets) < MAX_SHARE * len(one) else None


def scheduled(
    scenes: Scenes,
    near: tuple[IntArray, FloatArray] | None,
    meeting: IntArray | None,
    shared: tuple[TrackPairs | None, TrackPairs | None],
) -> Scenes:
    """Return scenes with their near pairs and those whose ways may meet, as of the functions above.

    Args:
        shared: values of equal tracks: of the pairs that may meet, and of the near ones.
    """
    close = None
    if near is not None:
        close = Near(scenes=scenes.of_pair_numbers(near[0], shared[1]), pair=near[0], apart=near[1])
    if meeting is None:
        return replace(scenes, near=close, shared=shared[0])
    among = close and replace(close.among(meeting, close.scenes), apart=close.apart[meeting])
    some = replace(scenes.of_pair_numbers(meeting, shared[0]), near=among)
    return replace(scenes, near=close, meeting=Some(scenes=some, pair=meeting))


def least_of_near(
    scenes: Scenes, values: Callable[[Scenes], Samples], within: Callable[[float], float]
) -> Samples:
    """Return values of pairs that have the smallest value of each scene: the near ones, or more if needed.

    Args:
        within: returns the distance between the circles beyond which no pair has a value as small, m.
    """
    if scenes.near is None:
        return values(scenes)
    found = values(scenes.near.scenes.under(scenes.preset))
    least = np.where(found.defined, found.value, np.inf).min(axis=0, initial=np.inf).max(initial=0.0)
    reach = within(float(least)) * (1 + ROUNDING) if np.isfinite(least) else np.inf
    if reach <= NEAR_M:
        return found
    (one, two), size = scenes.pairs, np.hypot(scenes.length, scenes.width).max(axis=(1, 2)) / 2
    some = scenes.near.apart <= reach + size[one] + size[two]
    some[scenes.near.pair] = True
    return values(scenes if some.all() else scenes.of_pair_numbers(np.flatnonzero(some)).under(scenes.preset))


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
        scene, size = np.flatnonzero(late), max(PAIR_STEPS // max(len(some), 1), 1)
        for part in (scene[start : start + size] for start in range(0, len(scene), size)):
            found.append((_of_scenes(scenes, part, some).following, some, part))
    return Following.join([scenes.numbered(*each) for each in found])


def _of_scenes(scenes: Scenes, scene: IntArray, pairs: IntArray) -> Scenes:
    """Return scenes, by flat index into (C, T), as steps of one future, with pairs by number."""
    at, tracks = np.divmod(scene, max(scenes.shape[1], 1)), scenes.tracks
    at = at[0], at[1] + tracks.first
    tracks = replace(
        tracks,
        states=tracks.states.map(lambda values: values[at][None]),
        present=None if tracks.present is None else tracks.present[at][None],
        acceleration=scenes.all_acceleration[at][None],
        length=np.atleast_2d(tracks.length)[0],  # sizes of one future: unused by leaders
        width=np.atleast_2d(tracks.width)[0],
        first=0,
    )
    return replace(scenes.of_pair_numbers(pairs), tracks=tracks, planned=None)
