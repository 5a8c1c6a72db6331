"""Needed braking and time margins of pairs on the ways that they drive: any two that meet.

Undefined where a vehicle of the pair is absent in some step. The numbers are those of `scex_sumo.decision`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

if TYPE_CHECKING:
    from scex_sumo.conflicts.braking import DrivenPaths, Shared


def needed_braking(scenes: Scenes) -> Samples:
    """Compute the least constant deceleration of either vehicle that avoids contact, m/s².

    The other one goes on: it brakes to rest, or accelerates for 1 s; two that face each other both brake.
    20 where none helps; undefined where none is needed. Every second step, from the first on.
    """
    from scex_sumo.conflicts.pairs import EVERY, braking_at

    ways, own, other = scenes.once(_touching)
    first, steps = scenes.tracks.first, np.arange(scenes.tracks.first, scenes.tracks.states.shape[1], EVERY)
    value: FloatArray = np.zeros((len(own.own), scenes.tracks.steps))
    value[:, steps - first] = braking_at(ways, own, other, steps)[0]
    return _samples(scenes, own, value, value > 0)


def time_margin(scenes: Scenes) -> Samples:
    """Compute the time between one vehicle leaving a place and the other one entering it, s.

    Headings there are 30° or more apart. It stands at the step in which the later one enters.
    """
    from scex_sumo.conflicts.pairs import time_margins

    ways, own, _ = scenes.once(_touching)
    margins = time_margins(ways, own.own, own.other, now=scenes.tracks.first)
    value: FloatArray = np.full((len(own.own), scenes.tracks.steps), np.inf)
    crosses = np.isfinite(margins.margin)
    value[crosses, np.maximum(margins.step[crosses] - scenes.tracks.first, 0)] = margins.margin[crosses]
    return _samples(scenes, own, value, np.isfinite(value))


def _touching(scenes: Scenes) -> tuple[DrivenPaths, Shared, Shared]:
    """Return the ways of all vehicles in all futures, and the stretches that two of a future share."""
    from scex_sumo.conflicts.braking import shared_stretches
    from scex_sumo.conflicts.pairs import ways_of

    tracks, plan = scenes.tracks, scenes.planned
    futures, _, vehicles = tracks.states.shape
    there: BoolArray = np.ones((futures, vehicles), np.bool_)
    if tracks.present is not None:
        there = np.asarray(tracks.present.all(axis=1))
    states = tracks.states.map(lambda values: np.where(there[:, None], values, 0.0))
    planned = None
    if plan is not None and not plan.driven and plan.x.shape[1]:
        ahead = plan.x.shape[3] if len(plan.column) == 0 else int(plan.column[-1])
        planned = np.stack([plan.x, plan.y])[:, :, -1, :, ahead:]
        last = np.stack([states.x[:, -1], states.y[:, -1]])[..., None]  # stands there without a plan
        planned = np.where(np.isnan(planned).any(axis=(0, 3), keepdims=True), last, planned)
    shape = futures, vehicles
    length, width = (np.broadcast_to(size, shape).ravel() for size in (tracks.length, tracks.width))
    ways = ways_of(states, length, width, planned)
    one, two = np.triu_indices(vehicles, 1)
    begin = vehicles * np.arange(futures)
    own, other = (begin + one[:, None]).ravel(), (begin + two[:, None]).ravel()
    both = there.ravel()[own] & there.ravel()[other]
    return ways, *shared_stretches(ways, own[both], other[both])


def _samples(scenes: Scenes, shared: Shared, value: FloatArray, defined: BoolArray) -> Samples:
    """Return (n, T) values of shared stretches as samples of pairs."""
    futures, _, vehicles = scenes.tracks.states.shape
    future = shared.own // vehicles
    key: IntArray = (shared.own % vehicles) * vehicles + shared.other % vehicles
    pairs, pair = np.unique(key, return_inverse=True)
    shape = len(pairs), futures, scenes.tracks.steps
    values, there = np.zeros(shape), np.zeros(shape, np.bool_)
    values[pair, future], there[pair, future] = value, defined
    return Samples(value=values, defined=there, row=pairs // vehicles, other=pairs % vehicles, symmetric=True)
