"""Plain world of arrays: what libsumo holds after a step too, where no vehicle is SUMO's to drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.scene import States


class PlainWorld:
    """A world that does as it is told: what libsumo holds after a step too, where all are overridden."""

    def __init__(self, children: int, vehicles: int) -> None:
        self._states = States.empty((children, vehicles))

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""
        states = states.map(lambda values: np.where(mask, values, np.nan))
        # As SUMO holds them: headings in (-pi, pi], and no speed below zero.
        heading = np.pi - np.mod(np.pi - states.heading, 2.0 * np.pi)
        self._states = replace(states, heading=heading, speed=np.where(states.speed < 0, 0.0, states.speed))

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Obstacles are read from the seed scene."""

    def step(self) -> None:
        """Nothing is left to do."""

    def read(self) -> States:
        """(C, V) what was told."""
        return self._states
