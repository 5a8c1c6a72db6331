"""Behaviour model protocols, what a model says of itself, and checks that the parameter classes share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.scene import Plan, SceneHistory, States, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.road import Road

PLAN_STEPS = 30
_PACKAGE: Final = __name__.partition(".")[0]
MIN_PARAMETER, MAX_PARAMETER = 1e-6, 1e6  # beyond them sums and squares could overflow
MAX_PATHS = 1000  # of one vehicle
Sight: TypeAlias = Literal["itself", "everyone"]
"""States that a plan depends on: the vehicle's own, or those of all vehicles."""
BY_ITSELF = "had no plan of its own"  # reason of a fallback if the model gives none


@runtime_checkable
class BatchBehavior(Protocol):
    """Behaviour model: pure, batched over vehicles and futures.

    Example:
        >>> isinstance(scex.parse_models, scex.Behavior)  # has it a method `plan` or `plan_one`?
        False
    """

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan at least 30 steps for the n vehicles in ``vehicles``.

        It is called once per replan, for all futures of the batch, and changes none of its arguments.

        Args:
            history: states now and 10 steps back.
            rng: (C,) one generator per future. Draw for a vehicle from its own future's generator only, so
                that the result does not depend on the batch.
        """
        ...


@runtime_checkable
class SingleVehicleBehavior(Protocol):
    """A model that plans for one vehicle of one future."""

    def plan_one(
        self, history: SceneHistory, road: Road, future: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        """Plan at least 30 steps for one vehicle.

        Args:
            history: states of its future alone; ``history.states[future, vehicle]`` (11,) are its own,
                ``history.states[future]`` (V, 11) those of all.
            future: index into the history, 0; ``history.futures[future]`` is the future's number.

        Returns:
            (H,) states of the centre; column 0 is the next step.
        """
        ...


Behavior: TypeAlias = BatchBehavior | SingleVehicleBehavior
"""A driver: it plans for many vehicles at once, or for one."""


class Driver:
    """What a model of this package declares beyond `plan`; a user's model declares nothing."""

    inner: Any = None  # the model that an adapter, such as the guard, wraps
    source_file: Path | None = None  # of a user's model
    weights_sha256: str | None = None  # of learned weights
    by_sumo: ClassVar[bool] = False  # whether the world leaves its vehicles to SUMO

    @property
    def sight(self) -> Sight | None:
        """States that plans depend on; None: random numbers, too, or possibly all."""
        return None

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Any:
        """Return the drive of vehicles along their paths, an `Intent`; None: they have only plans."""
        return None

    def clear_of_others(self) -> Any:
        """Return a copy that steers away from vehicles beside it, or the model if it cannot."""
        return self

    def try_on(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> None:
        """Raise a `ScexError` if no plan for these vehicles is usable."""


def layers(model: Any) -> Iterator[Driver]:
    """Yield a driver of this package and those that it wraps; a user's may inherit what it is not."""
    while isinstance(model, Driver) and type(model).__module__.startswith(f"{_PACKAGE}."):
        yield model
        model = model.inner


def declared(model: Any) -> Driver:
    """Return what a model declares: itself, or nothing for a user's."""
    return next(layers(model), Driver())


def driven_by_sumo(model: Any) -> bool:
    """Return whether SUMO drives the vehicles of a model."""
    return isinstance(model, Driver) and model.by_sumo


def clear_of_others(model: Any) -> Any:
    """Return a copy of a model that steers away from vehicles beside it, or the model if it cannot."""
    return next((layer.clear_of_others() for layer in layers(model)), model)


def check_positive(parameters: Any, *names: str, zero: bool = False) -> None:
    """Raise a `UsageError` unless the named attributes are positive (or zero, if allowed)."""
    for name in names:
        value = getattr(parameters, name)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not (MIN_PARAMETER <= value <= MAX_PARAMETER or (value == 0 and zero)):
            wanted = f"{'0 or ' if zero else ''}a number from {MIN_PARAMETER:g} to {MAX_PARAMETER:g}"
            raise UsageError(f"{name}: got {value!r}; give {wanted}")


def check_path(path: Any) -> None:
    """Raise a `UsageError` unless a path is an index, ``straight`` or ``random``."""
    number = isinstance(path, int) and not isinstance(path, bool) and abs(path) < MAX_PATHS
    if not (number or path in ("straight", "random")):
        raise UsageError(f"path: got {path!r}; give an index from left to right, straight, or random")
