"""Plain world of arrays, and checked world, which compares it with SUMO's.

Where SUMO drives nobody, a plain world equals libsumo after each step, to the bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, World, WorldRequest
from scex_sumo.world.batch import angle_read_back, from_sumo, to_sumo
from scex_sumo.world.sumo import SumoSimulator

SAMPLE = 2  # futures of a checked batch in SUMO


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
