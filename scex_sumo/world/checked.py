"""Checked world: plain arrays, beside which SUMO holds a sample of the children."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.errors import SimulationError
from scex_sumo.scene import States
from scex_sumo.world.base import World


class CheckedWorld:
    """A plain world whose first children run in SUMO's world too; both must hold the same, to the bit."""

    def __init__(self, plain: World, sumo: World, sample: int) -> None:
        """Take two worlds that have been set to the seed scene.

        Args:
            plain: of all children.
            sumo: of the first of them.
            sample: how many these are.
        """
        self._plain, self._sumo, self._sample = plain, sumo, sample

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""
        self._plain.move(states, mask)
        self._sumo.move(states[: self._sample], mask[: self._sample])

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Obstacles are read from the seed scene."""

    def step(self) -> None:
        """Advance both by 0.1 s."""
        self._plain.step()
        self._sumo.step()

    def read(self) -> States:
        """(C, V) what the plain world holds.

        Raises:
            SimulationError: SUMO holds something else.
        """
        held, theirs = self._plain.read(), self._sumo.read()
        for name in ("x", "y", "heading", "speed"):
            ours, sumos = getattr(held, name)[: self._sample], getattr(theirs, name)
            if not np.array_equal(ours, sumos):
                raise SimulationError(
                    f"the plain world and SUMO differ in {name} by {np.abs(ours - sumos).max():.3g}; "
                    "use --world sumo and please report this with the seed scene"
                )
        return held
