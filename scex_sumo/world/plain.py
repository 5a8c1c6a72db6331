"""Plain world of arrays: what libsumo holds after a step too, where no vehicle is SUMO's to drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.scene import States
from scex_sumo.world.frame import from_sumo, returned, to_sumo


class PlainWorld:
    """A world that does as it is told: what libsumo holds after a step too, where all are overridden."""

    def __init__(self, children: int, vehicles: int, *, length: FloatArray | None = None) -> None:
        """Nobody is anywhere yet.

        Args:
            children: C.
            vehicles: V.
            length: (V,) m, to hold to the bit what SUMO holds, which knows front bumpers and degrees; None
                for states as told.
        """
        self._states = States.empty((children, vehicles))
        self._length = length

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""
        states = states.map(lambda values: np.where(mask, values, np.nan))
        speed = np.where(states.speed < 0, 0.0, states.speed)  # SUMO knows no speed below zero
        if self._length is not None:
            x, y, angle = to_sumo(states, self._length)
            self._states = from_sumo(x, y, returned(angle), speed, self._length)
            return
        heading = np.pi - np.mod(np.pi - states.heading, 2.0 * np.pi)  # in (-pi, pi]
        self._states = replace(states, heading=heading, speed=speed)

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Obstacles are read from the seed scene."""

    def step(self) -> None:
        """Nothing is left to do."""

    def read(self) -> States:
        """(C, V) what was told."""
        return self._states
