"""Checked world: a plain world of arrays, compared with SUMO's."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, World, WorldRequest
from scex_sumo.world.plain import PlainSimulator
from scex_sumo.world.sumo import SumoSimulator

SAMPLE = 2  # futures of a checked batch in SUMO


class _CheckedWorld:
    """Plain world whose first futures run in SUMO's world, too; both must be equal, to the bit."""

    def __init__(self, plain: World, sumo: World, sample: int) -> None:
        self._plain, self._sumo, self._sample = plain, sumo, sample

    def move(self, states: States, mask: BoolArray) -> None:
        self._plain.move(states, mask)
        self._sumo.move(states[: self._sample], mask[: self._sample])

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Do nothing: behaviour models read obstacles from the seed scene."""

    def step(self) -> None:
        self._plain.step()
        self._sumo.step()

    def read(self) -> States:
        held, theirs = self._plain.read(), self._sumo.read()
        for name in ("x", "y", "heading", "speed"):
            ours, sumos = getattr(held, name)[: self._sample], getattr(theirs, name)
            if not np.array_equal(ours, sumos):
                raise SimulationError(
                    f"the plain world and SUMO differ in {name} by {np.abs(ours - sumos).max():.3g}; use "
                    "--world sumo and please report this with the seed scene"
                )
        return held


class CheckedSimulator:
    """Simulator of checked worlds.

    SUMO simulates all futures if it drives or shows vehicles. Without a comparison the world is plain.
    """

    has_sumo = True

    def __init__(self, request: WorldRequest) -> None:
        self._needs_sumo = request.sumo_drives or request.gui
        self._plain = PlainSimulator(request)
        self._sumo = SumoSimulator(request) if self._needs_sumo or request.compared else None

    def __enter__(self) -> CheckedSimulator:
        return self

    def __exit__(self, *error: object) -> None:
        if self._sumo is not None:
            self._sumo.__exit__(*error)

    def begin(self, batch: BatchStart) -> World:
        """Return the world of a batch."""
        if self._sumo is None:
            return self._plain.begin(batch)
        if self._needs_sumo:
            return self._sumo.begin(batch)
        some = BatchStart(slots=batch.slots[:SAMPLE], assignment=batch.assignment[:SAMPLE])
        return _CheckedWorld(self._plain.begin(batch), self._sumo.begin(some), len(some.slots))
