"""Arrivals of vehicles of a SUMO simulation: whoever drives, each leaves a future where its route ends.

Vehicles of recordings have no known destination: they stay, as in the paper.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.scene import SeedScene, States

FAR_M: Final = 1e6
FAR_APART_M: Final = 1e3

_BEYOND_M = (0.0, 10.0)  # of the front bumper
_ASIDE_M = 2.0
_TURNED_COS = 0.5


class Arrivals:
    """Places where the vehicles of a scene arrive."""

    def __init__(self, scene: SeedScene) -> None:
        known = [
            (v, *place)
            for v, intention in enumerate(scene.intentions)
            if intention is not None
            for place in intention.arrives
        ]
        places = np.array(known, dtype=np.float64).reshape(-1, 4)
        self._vehicle, (self._x, self._y, self._heading) = places[:, 0].astype(np.int64), places[:, 1:].T
        self._half = scene.length[self._vehicle] / 2

    def reached(self, states: States) -> BoolArray:
        """Return whether vehicles (C, V) have arrived."""
        reached = np.zeros(states.shape, dtype=np.bool_)
        if not len(self._vehicle):
            return reached
        now, c, s = states[:, self._vehicle], np.cos(self._heading), np.sin(self._heading)
        dx, dy = now.x - self._x, now.y - self._y
        turned = np.cos(now.heading - self._heading)
        beyond, aside = dx * c + dy * s + self._half * turned, dy * c - dx * s
        there = (beyond >= _BEYOND_M[0]) & (beyond <= _BEYOND_M[1])
        there &= (np.abs(aside) <= _ASIDE_M) & (turned >= _TURNED_COS)
        future, row = np.nonzero(there)
        reached[future, self._vehicle[row]] = True
        return reached


def far_away(states: States, gone: BoolArray) -> States:
    """Return states (C, V, ...) in which some vehicles stand where no other one sees them, nor each other."""
    vehicle = np.arange(gone.shape[1]).reshape((-1, *(1,) * (gone.ndim - 2)))
    return States(
        x=np.where(gone, FAR_M + FAR_APART_M * vehicle, states.x),
        y=np.where(gone, FAR_M, states.y),
        heading=np.where(gone, 0.0, states.heading),
        speed=np.where(gone, 0.0, states.speed),
    )
