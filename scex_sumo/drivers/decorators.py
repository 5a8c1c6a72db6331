"""Decorators that name users' drivers: classes, functions that make one, functions that predict."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.drivers import registry
from scex_sumo.plug_in.user_model import predictor_model

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


@checked
def behavior(name: str) -> Callable[[T], T]:
    """Register a behaviour model: ``@behavior("my_driver")`` on a class with ``plan`` or ``plan_one``.

    See `Behavior`. Keyword arguments of the constructor are the parameters. A
    function of a vehicle's ``history`` becomes a `Predictor`.

    Raises:
        UsageError: the name is taken or cannot be written on a command line.

    Example:
        >>> @scex.behavior("parked")
        ... class Parked:
        ...     def plan(self, history, road, vehicles, rng):
        ...         now = history.now[vehicles.future, vehicles.vehicle]
        ...         x, y, heading = (np.repeat(a[:, None], 30, axis=1) for a in (now.x, now.y, now.heading))
        ...         return scex.Plan(x=x, y=y, heading=heading, speed=np.zeros_like(x))
        >>> [str(model) for model in scex.parse_models("parked")]
        ['parked']
    """

    def register(constructor: T) -> T:
        if name in {*registry.CORE, registry.SUMO, *registry.MIXES} or registry.EXTENSIONS.is_ours(name):
            raise UsageError(f"behavior {name!r}: the name belongs to a built-in model; choose another one")
        if not name or any(c in name for c in ",:@= \t\n"):
            raise UsageError(f"behavior {name!r}: a name must not contain , : @ = or spaces")
        if not callable(constructor):
            raise UsageError(f"behavior {name!r}: register a class or a function that makes a model")
        registry._registered[name] = registry.entry_of_object(constructor, name)
        return constructor

    return register


def predictor(name: str | None = None, *, batched: bool = False, **surroundings: Any) -> Callable[[F], F]:
    """Register a function that predicts trajectories: ``@predictor("my_driver")``.

    Args:
        name: None gives it no name except its import path.
        batched: as in `Predictor`.
        surroundings: fields of `Surroundings`; they become parameters of the model.

    Raises:
        UsageError: the name is taken, or the function asks for unknown inputs.

    Example:
        >>> @scex.predictor("straight")
        ... def straight(history):
        ...     way = 0.1 * history[:, -1, 4:] * np.arange(1, 31)
        ...     return np.stack([way, np.zeros_like(way)], axis=-1)
        >>> [str(model) for model in scex.parse_models("straight:radius=30")]
        ['straight:radius=30']
    """

    def register(function: F) -> F:
        model = predictor_model(function, batched=batched, **surroundings)
        model.make()  # raises where the function is written, not where it is used
        function.__scex_predictor__ = model  # type: ignore[attr-defined]
        return function if name is None else behavior(name)(function)

    return register
