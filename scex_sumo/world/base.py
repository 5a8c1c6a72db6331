"""World as the closed loop sees it: whatever moves vehicles to their next states and says what then holds."""

from __future__ import annotations

from typing import Protocol

from scex_sumo.arrays import BoolArray
from scex_sumo.scene import States


class World(Protocol):
    """What the loop needs of a world that has been set to the seed scene."""

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Set the replayed participants' next states, (O,)."""

    def step(self) -> None:
        """Advance by 0.1 s."""

    def read(self) -> States:
        """What the world holds after the step, (C, V)."""
