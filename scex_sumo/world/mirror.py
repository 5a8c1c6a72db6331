"""Mirror image of a world: SUMO simulates traffic on the left as traffic on the right.

So futures of a map and of its image are each other's image to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.net.mirror import mirrored_net
from scex_sumo.roads.mirror import mirrored_scene, mirrored_states
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, Simulator, World, WorldRequest


class MirroredSimulator:
    """Simulator of the image of a seed scene."""

    has_sumo = True

    def __init__(self, simulator: Callable[[WorldRequest], Simulator], request: WorldRequest) -> None:
        self._folder = TemporaryFolder()
        image = mirrored_net(request.net, Path(self._folder.name))
        self._inner = simulator(replace(request, scene=mirrored_scene(request.scene), net=image))

    def __enter__(self) -> MirroredSimulator:
        self._inner.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._inner.__exit__(*error)
        self._folder.cleanup()

    def begin(self, batch: BatchStart) -> World:
        """Return the world, set to the seed scene."""
        return _MirroredWorld(self._inner.begin(batch))


class _MirroredWorld:
    """World that is told and tells the image of its states."""

    def __init__(self, inner: World) -> None:
        self._inner = inner
        self.step = inner.step

    def move(self, states: States, mask: BoolArray) -> None:
        self._inner.move(mirrored_states(states), mask)

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        self._inner.move_obstacles(mirrored_states(states), present)

    def read(self) -> States:
        return mirrored_states(self._inner.read())
