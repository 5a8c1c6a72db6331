"""Encounters of pairs of vehicles: least gap, criticality, collision.

A pair has an encounter if its outlines come within 10 m, one vehicle leads the other on its path, their
planned paths cross, or they collide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows, least_of
from scex_sumo.metrics.collisions import Collisions
from scex_sumo.metrics.events import EVENTS, Event
from scex_sumo.metrics.formulas.crossing import pet
from scex_sumo.metrics.formulas.distance import gap_bounds, gaps_of
from scex_sumo.metrics.formulas.following import deceleration_to_avoid_crash, time_to_collision
from scex_sumo.metrics.pairs.leaders import leaders_on_path
from scex_sumo.metrics.pairs.paths_ahead import paths_ahead
from scex_sumo.metrics.pairs.scenes import Scenes

NEAR_M: Final = 10.0
NO_COLLISION: Final = -1
_MARGIN = 1e-6  # for rounding, so that the nearest step is never lost


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounters(Rows):
    """One row per future and pair with an encounter, sorted by future and pair; ``first`` is the lower index.

    Attributes:
        time_s: after the seed moment: of the collision, else a critical least TTC, else the least gap.
    """

    future: IntArray
    first: IntArray
    second: IntArray
    gap: FloatArray  # least body gap, m; inf above 10 m
    ttc: FloatArray  # least TTC on the path of either, s; inf if no gap closes
    pet: FloatArray  # least PET, s; inf if the tracks do not cross
    drac: FloatArray  # largest DRAC on the path of either, m/s²; 0 if no gap closes
    kind: IntArray  # of the collision, index into `KINDS`; -1 without one
    time_s: FloatArray
    x: FloatArray  # midpoint of both centres then, m
    y: FloatArray
    relative_speed: FloatArray  # at impact, m/s; 0 without a collision
    consequence: BoolArray  # a vehicle of the pair that touches had collided before
    towards: IntArray  # 1 if the first vehicle hits or follows the second, -1 for the reverse, 0 else

    def __len__(self) -> int:
        return len(self.future)

    @property
    def collided(self) -> BoolArray:
        """(N,) whether the pair collides, and neither vehicle has collided before."""
        return np.asarray((self.kind != NO_COLLISION) & ~self.consequence)

    def happens(self, event: Event) -> BoolArray:
        """Return (N,) whether an event happens; a collision counts as each."""
        return event.happens(getattr(self, event.value)) | self.collided


def encounters_of(scenes: Scenes, collisions: Collisions, start: int, *, on_paths: bool = True) -> Encounters:
    """Find the encounters of a batch of scenes; ``start`` is the number of its first future.

    Without ``on_paths``, only gaps and collisions make an encounter.
    """
    scenes = scenes if scenes.near is None else scenes.near.scenes
    futures, steps = scenes.shape
    inside = (collisions.future >= start) & (collisions.future < start + futures)
    hits = collisions.take(np.flatnonzero(inside))
    first, second = scenes.pairs
    size = len(first) * futures
    gap, gap_step = scenes.of_pairs(_least_gaps).reshape(size, 2).T
    if on_paths:
        least_pet, cross = scenes.of_pairs(_crossings).reshape(size, 2).T
        ttc, ttc_step, drac, towards = _on_paths(scenes)
    else:
        cross, drac = np.zeros((2, size))
        least_pet, ttc = np.full((2, size), np.inf)
        ttc_step, towards = np.full(size, -1), np.zeros(size, dtype=np.int64)
    kind, is_later = np.full(size, NO_COLLISION), np.zeros(size, dtype=np.bool_)
    impact, x, y, speed = np.zeros((4, size))
    low, high = np.minimum(hits.first, hits.second), np.maximum(hits.first, hits.second)
    number = np.zeros((scenes.vehicles, scenes.vehicles), dtype=np.int64)
    number[first, second] = np.arange(len(first))
    hit = number[low, high] * futures + hits.future - start
    kind[hit], impact[hit], speed[hit] = hits.kind, hits.time_s, hits.relative_speed
    is_later[hit] = hits.consequence
    hit_by = (hits.first_side == 0).astype(np.int64) - (hits.second_side == 0)  # 1 if the front hits
    towards[hit] = np.where(hits.first == low, hit_by, -hit_by)
    # Steps count from the first evaluated one, times from the seed moment before it.
    near = np.where(np.isfinite(gap), gap_step, ttc_step).astype(np.int64)
    critical = np.where(EVENTS["ttc"].happens(ttc), ttc_step, near)
    after = 1 if scenes.tracks.first else 0
    time = np.where(kind != NO_COLLISION, impact, (critical + after) * scenes.tracks.step_s)
    is_near = np.isfinite(gap) | np.isfinite(least_pet) | (cross > 0)
    meets = is_near | (kind != NO_COLLISION) | (ttc_step >= 0)
    future, pair = np.nonzero(meets.reshape(-1, futures).T)
    rows = pair * futures + future
    step = np.clip(critical[rows], 0, max(steps - 1, 0))
    x[rows] = (scenes.x[first[pair], future, step] + scenes.x[second[pair], future, step]) / 2
    y[rows] = (scenes.y[first[pair], future, step] + scenes.y[second[pair], future, step]) / 2
    x[hit], y[hit] = hits.x, hits.y
    return Encounters(
        future=future + start,
        first=first[pair],
        second=second[pair],
        gap=np.where(kind[rows] != NO_COLLISION, 0.0, gap[rows]),
        ttc=ttc[rows],
        pet=least_pet[rows],
        drac=drac[rows],
        kind=kind[rows],
        time_s=np.maximum(time[rows], 0.0),
        x=x[rows],
        y=y[rows],
        relative_speed=speed[rows],
        consequence=is_later[rows],
        towards=towards[rows],
    )


def _crossings(scenes: Scenes) -> FloatArray:
    """Return (P, C, 2) least PET of pairs, and whether their planned paths cross."""
    futures, steps = scenes.shape
    pairs = len(scenes.pairs[0])
    size, times = pairs * futures, pet(scenes)
    time = np.full(2 * size, np.inf)
    np.minimum.at(time, times.where // max(steps, 1), times.value)
    least_pet = np.minimum(time[:size], time[size:])
    cross = np.zeros(size)
    if scenes.planned is not None and size and steps:
        ordered, scene = np.divmod(scenes.once(paths_ahead).next_crossings.where, scenes.count)
        cross[(ordered % pairs) * futures + scene // steps] = 1.0
    return np.stack([least_pet, cross], axis=1).reshape(-1, futures, 2)


def _least_gaps(scenes: Scenes) -> FloatArray:
    """Return (P, C, 2) least gaps and their steps; the gap is inf above `NEAR_M`."""
    futures, steps = scenes.shape
    size = len(scenes.pairs[0]) * futures
    low, high = gap_bounds(scenes)
    bound = np.where(scenes.both_present, high, np.inf).min(axis=2, initial=np.inf, keepdims=True)
    close = scenes.both_present & (low <= np.minimum(bound, NEAR_M) + _MARGIN)
    flat = np.flatnonzero(close)
    key = flat // max(steps, 1)
    gaps = gaps_of(scenes, *np.divmod(flat, scenes.count))
    gap, step = _extremum(key, flat % max(steps, 1), np.where(gaps <= NEAR_M, gaps, np.inf), size)
    return np.stack([gap, step], axis=1).reshape(-1, futures, 2)


def _on_paths(scenes: Scenes) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    futures, steps = scenes.shape
    size = len(scenes.pairs[0]) * futures
    following = scenes.once(leaders_on_path)
    ordered, scene = np.divmod(following.where, scenes.count)
    pair = ordered % max(len(scenes.pairs[0]), 1)
    key, step = pair * futures + scene // max(steps, 1), scene % max(steps, 1)
    closing = following.follower_speed - following.leader_speed
    time = time_to_collision(gap=following.gap, closing_speed=closing)
    ttc, ttc_step = _extremum(key, step, time, size)
    drac = np.zeros(size)
    np.maximum.at(drac, key, deceleration_to_avoid_crash(gap=following.gap, closing_speed=closing))
    follows = np.bincount(key, np.where(ordered < len(scenes.pairs[0]), 1.0, -1.0), minlength=size)
    return ttc, ttc_step, drac, np.sign(follows).astype(np.int64)


def _extremum(key: IntArray, step: IntArray, value: FloatArray, size: int) -> tuple[FloatArray, IntArray]:
    """Return the least values of keys (size,) and their first steps; inf and -1 without a value."""
    first = least_of(key, value, step)
    least, at_step = np.full(size, np.inf), np.full(size, -1)
    least[key[first]], at_step[key[first]] = value[first], step[first]
    return least, at_step
