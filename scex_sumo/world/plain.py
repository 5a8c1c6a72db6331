"""Plain world of arrays: what libsumo holds after a step too, where no vehicle is SUMO's to drive."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.scene import States


class PlainWorld:
    """A world that does as it is told: what libsumo holds after a step too, where all are overridden."""

    def __init__(self, children: int, vehicles: int) -> None:
        self._states = States.empty((children, vehicles))

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""
        self._states = states.map(lambda values: np.where(mask, values, np.nan))

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Obstacles are read from the seed scene."""

    def step(self) -> None:
        """Nothing is left to do."""

    def read(self) -> States:
        """(C, V) what was told."""
        return self._states
