"""Registration of a behaviour model of your own, by a decorator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors import registry
from scex_sumo.behaviors.registry import EXTENSIONS, MIXES, SUMO

T = TypeVar("T")


def behavior(name: str) -> Callable[[T], T]:
    """Register a behaviour model: ``@behavior("my_driver")`` on a class with ``plan`` or ``plan_one``.

    See `Behavior` and `SingleVehicleBehavior`. Keyword arguments of the constructor are the parameters. A
    function of a vehicle's ``history`` becomes a `Predictor`.

    Raises:
        UsageError: the name is taken or cannot be written on a command line.

    Example:
        >>> @scex.behavior("parked")
        ... class Parked:
        ...     def plan(self, history, road, who, rng):
        ...         now = history.now[who.future, who.vehicle]
        ...         x, y, heading = (np.repeat(a[:, None], 30, axis=1) for a in (now.x, now.y, now.heading))
        ...         return scex.Plan(x=x, y=y, heading=heading, speed=np.zeros_like(x))
        >>> [str(model) for model in scex.parse_models("parked")]
        ['parked']
    """

    def register(constructor: T) -> T:
        if (
            name in {*registry._CORE, SUMO, *registry._MIXES}
            or EXTENSIONS.is_ours(name)
            or MIXES.is_ours(name)
        ):
            raise UsageError(f"behavior {name!r}: the name belongs to a built-in model; choose another one")
        if not name or any(c in name for c in ",:@= \t\n"):
            raise UsageError(f"behavior {name!r}: a name must not contain , : @ = or spaces")
        if not callable(constructor):
            raise UsageError(f"behavior {name!r}: register a class or a function that makes a model")
        registry._registered[name] = registry._entry(constructor, name)
        return constructor

    return register
