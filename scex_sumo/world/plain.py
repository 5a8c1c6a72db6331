"""Plain world of arrays.

Where SUMO drives nobody, a plain world equals libsumo after each step, to the bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, World, WorldRequest
from scex_sumo.world.batch import angle_read_back, from_sumo, to_sumo


class PlainWorld:
    """World of arrays: vehicles are where they were moved to."""

    def __init__(self, futures: int, vehicles: int, *, length: FloatArray | None = None) -> None:
        """Make a world without states.

        ``length`` (V,), m, rounds as SUMO, which stores front bumpers and degrees; None rounds nothing.
        """
        self._states = States.empty((futures, vehicles))
        self._length = length

    def move(self, states: States, mask: BoolArray) -> None:
        """Set the next states (C, V) where ``mask`` is True."""
        states = states.map(lambda values: np.where(mask, values, np.nan))
        speed = np.where(states.speed < 0, 0.0, states.speed)  # SUMO has no negative speeds
        if self._length is not None:
            x, y, angle = to_sumo(states, self._length)
            self._states = from_sumo(x, y, angle_read_back(angle), speed, self._length)
            return
        heading = np.pi - np.mod(np.pi - states.heading, 2.0 * np.pi)  # in (-pi, pi]
        self._states = replace(states, heading=heading, speed=speed)

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Do nothing: models read obstacles from the seed scene."""

    def step(self) -> None:
        """Do nothing."""

    def read(self) -> States:
        """Return the states (C, V) that were set."""
        return self._states


class PlainSimulator:
    """Simulator of plain worlds."""

    has_sumo = False

    def __init__(self, request: WorldRequest) -> None:
        self.scene = request.scene

    def __enter__(self) -> PlainSimulator:
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing."""

    def begin(self, batch: BatchStart) -> World:
        """Return a plain world."""
        return PlainWorld(len(batch.slots), self.scene.vehicles, length=self.scene.length)
