"""Motion after a collision: a plastic impact, then both slide straight on to rest; contacts that are none.

The impact is that of the severity in `scex_sumo.results.tables.outcomes`, along the heading of each
vehicle: none turns or is pushed aside. It goes on as long as two that touch close in. Both decelerate as
with sliding tyres on dry asphalt, about 0.7 g.

Source: Fricke, Baker, Drag factor and coefficient of friction in traffic accident reconstruction, topic 862
of the Traffic Accident Investigation Manual (Northwestern University Traffic Institute 1990).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import wrap
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, Contacts, find_collisions
from scex_sumo.results.tables.outcomes import masses
from scex_sumo.scene import STEP_S, SeedScene, States

CRASH_MPS2: Final = 0.7 * 9.81
_ASLANT_RAD: Final = 0.2  # vehicles on lanes of one direction are closer to parallel
_GRAZE: Final = 0.25  # of the smaller outline; a vehicle that drives through another one overlaps it by more


class Crashes:
    """Vehicles that have collided, in a batch of futures.

    Attributes:
        crashed: (C, V) whether a vehicle has collided.
    """

    def __init__(self, scene: SeedScene, futures: int) -> None:
        """Begin at the seed moment."""
        self._contacts = Contacts(scene.now, scene.length, scene.width, uncounted(scene))
        mass = masses(scene.types, scene.length)
        self._mass = np.where(np.isnan(mass), np.nanmean(mass) if (mass > 0).any() else 1.0, mass)
        self.crashed: BoolArray = np.zeros((futures, scene.vehicles), dtype=np.bool_)

    def after_step(
        self, before: States, after: States, steps: int
    ) -> tuple[tuple[IntArray, IntArray], States]:
        """Return future and vehicle (n,) of those in contact between two states (C, V), and their motion.

        The motion (n, steps) begins with the step after ``after``.
        """
        future, *pair = self._contacts.in_step(before, after)
        speed = np.full(after.shape, np.inf)
        for vehicle, impact in zip(pair, self._impacts(after, future, *pair), strict=True):
            np.minimum.at(speed, (future, vehicle), impact)
        futures, vehicles = np.nonzero(np.isfinite(speed))
        which = futures.astype(np.int64), vehicles.astype(np.int64)
        self.crashed[which] = True
        return which, slide(after[which], speed[which], steps)

    def _impacts(
        self, states: States, future: IntArray, first: IntArray, second: IntArray
    ) -> list[FloatArray]:
        """Return the speeds (n,) of both vehicles after the impact, m/s; their own if they part."""
        share = self._mass[first] / (self._mass[first] + self._mass[second])
        pair = [states[future, vehicle] for vehicle in (first, second)]
        velocity = [now.speed * np.exp(1j * now.heading) for now in pair]  # complex: x and y
        common = share * velocity[0] + (1 - share) * velocity[1]
        between = (pair[1].x - pair[0].x) + 1j * (pair[1].y - pair[0].y)
        closes = ((velocity[1] - velocity[0]) * between.conj()).real < 0
        after = [np.maximum((common * np.exp(-1j * now.heading)).real, 0.0) for now in pair]
        return [np.where(closes, new, now.speed) for new, now in zip(after, pair, strict=True)]


def slide(now: States, speed: FloatArray, steps: int) -> States:
    """Return the motion (n, steps) of vehicles that slide straight on from their states (n,).

    Args:
        speed: (n,) from which they decelerate, m/s.
    """
    time = STEP_S * np.arange(1, steps + 1)
    slowed = np.maximum(speed[:, None] - CRASH_MPS2 * time, 0.0)
    distance_m = (speed[:, None] ** 2 - slowed**2) / (2 * CRASH_MPS2)
    return now.ahead(distance_m, slowed)


@owner_cache
def touch_in_simulation(scene: SeedScene) -> list[tuple[int, int]]:
    """Return the pairs of vehicles (indices) whose bodies touch aslant as their SUMO simulation goes on.

    SUMO counts along lanes, and sees no bodies: where a net's lanes split or turn sharply, these overlap
    while nothing happens. What a simulation shows in its next 5 s is the net's, and counts in no future.
    """
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
    heading, other_heading = (states.heading[vehicles, hits.step] for vehicles in (hits.first, hits.second))
    outline = scene.length * scene.width
    smaller = np.minimum(outline[hits.first], outline[hits.second])
    nets = (np.abs(wrap(heading - other_heading)) > _ASLANT_RAD) & (hits.overlap < _GRAZE * smaller)
    return list(zip(hits.first[nets].tolist(), hits.second[nets].tolist(), strict=True))


def uncounted(scene: SeedScene) -> BoolArray:
    """Return (V, V) whether a contact of two is no collision: two people, and `touch_in_simulation`."""
    people = np.zeros(scene.vehicles, np.bool_) if scene.people is None else scene.people
    pairs: BoolArray = people[:, None] & people
    for first, second in touch_in_simulation(scene):
        pairs[first, second] = pairs[second, first] = True
    return pairs
