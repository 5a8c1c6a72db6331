"""World and simulator protocols, and the registry of simulators (entry points in ``scex_sumo.worlds``).

``--world`` takes a name of the registry, or ``package.module:Class``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.base.importing import Registry
from scex_sumo.scene import SeedScene, States

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet

DEFAULT_WORLD = "sumo"
WORLDS = Registry(group="scex_sumo.worlds", kind="world")


class World(Protocol):
    """Batch of futures in closed loop, set to the seed scene."""

    def move(self, states: States, mask: BoolArray) -> None:
        """Set the next states (C, V) where ``mask`` is True; SUMO drives the others.

        A vehicle that SUMO drives may be set from some step on, to the end.
        """

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Set the next states (O,) of replayed pedestrians and cyclists."""

    def step(self) -> None:
        """Advance by 0.1 s."""

    def read(self) -> States:
        """Return the states (C, V) after the step; NaN of a vehicle that SUMO drove and that has arrived."""


@dataclass(frozen=True, kw_only=True)
class SumoDriven:
    """Vehicle with a car-following model of SUMO, e.g. ``EIDM``.

    Attributes:
        vehicle: index in the seed scene.
        parameters: ``vType`` attributes.
        edges: route; the vehicle is on the first edge.
        arrival: where it arrives on the last edge, as of `Intention`; None: it drives on, straight ahead.
    """

    future: int
    vehicle: int
    model: str
    parameters: Mapping[str, str]
    edges: tuple[str, ...]
    arrival: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldRequest:
    """Request for a simulator; ``models`` are names, ``slots`` the tile slots of all futures."""

    scene: SeedScene
    net: SumoNet
    slots: Sequence[int]
    models: Sequence[str] = ()
    gui: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchStart:
    """Futures of a batch.

    Attributes:
        slots: (C,) tile slots; futures share one if SUMO drives nobody and nobody watches.
        assignment: (C, V) index into the models of the request; empty: vehicles get no colours.
        driven: vehicles that SUMO drives; all others must be moved before each step.
    """

    slots: IntArray
    assignment: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    driven: Sequence[SumoDriven] = ()


class Simulator(Protocol):
    """Simulator of one seed scene: a context manager, one per process."""

    has_sumo: ClassVar[bool]
    """Whether SUMO can drive vehicles in it, and show it in sumo-gui."""

    def __init__(self, request: WorldRequest) -> None: ...

    def __enter__(self) -> Simulator: ...

    def __exit__(self, *error: object) -> None: ...

    def begin(self, batch: BatchStart) -> World:
        """Return a world with all vehicles at the seed scene; the previous world has ended."""
