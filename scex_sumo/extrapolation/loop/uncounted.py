"""Pairs whose contact is no collision: two people, and vehicles that touch as SUMO itself drives them.

SUMO counts along lanes, and sees no bodies: where a net's lanes split or turn sharply, these overlap while
nothing happens. What a simulation shows in its next 5 s is the net's, and counts in no future.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import wrap
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, find_collisions
from scex_sumo.scene import STEP_S, SeedScene, States

_ASLANT_RAD: Final = 0.2  # vehicles on lanes of one direction are closer to parallel
_GRAZE: Final = 0.25  # of the smaller outline; who drives through another vehicle overlaps it by more


@owner_cache
def touch_in_simulation(scene: SeedScene) -> list[tuple[int, int]]:
    """Return the pairs of vehicles (indices) whose bodies touch aslant as their SUMO simulation goes on."""
    valid = scene.future_valid
    if scene.source.get("kind") != "simulation" or scene.future is None or valid is None:
        return []
    states = States.concatenate([scene.history[:, -1:], scene.future], axis=1)
    there = np.concatenate([np.ones_like(valid[:, :1]), np.cumprod(valid, axis=1, dtype=np.bool_)], axis=1)
    tracks = SceneTracks(
        states=states.map(lambda values: values.T[None]),
        length=scene.length,
        width=scene.width,
        present=there.T[None],
        step_s=STEP_S,
        first=1,
        types=scene.types,
    )
    hits = find_collisions(tracks, limit_m2=CONTACT_M2)
    one, two = (states.heading[vehicles, hits.step] for vehicles in (hits.first, hits.second))
    outline = scene.length * scene.width
    smaller = np.minimum(outline[hits.first], outline[hits.second])
    nets = (np.abs(wrap(one - two)) > _ASLANT_RAD) & (hits.overlap < _GRAZE * smaller)
    return list(zip(hits.first[nets].tolist(), hits.second[nets].tolist(), strict=True))


def uncounted(scene: SeedScene) -> BoolArray:
    """Return (V, V) whether a contact of two vehicles is no collision."""
    people = np.zeros(scene.vehicles, np.bool_) if scene.people is None else scene.people
    pairs: BoolArray = people[:, None] & people
    for one, two in touch_in_simulation(scene):
        pairs[one, two] = pairs[two, one] = True
    return pairs
