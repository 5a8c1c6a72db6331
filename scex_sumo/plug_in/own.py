"""Registration of a behaviour model or a metric of your own, by a decorator."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, TypeVar

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors import registry as behaviors
from scex_sumo.behaviors.registry import EXTENSIONS, MIXES, SUMO
from scex_sumo.metrics import registry as metrics
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes
from scex_sumo.metrics.registry import METRICS, Metric

T = TypeVar("T")
F = TypeVar("F", bound=Callable[[Scenes], Samples | Entries])


@checked
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
            name in {*behaviors._CORE, SUMO, *behaviors._MIXES}
            or EXTENSIONS.is_ours(name)
            or MIXES.is_ours(name)
        ):
            raise UsageError(f"behavior {name!r}: the name belongs to a built-in model; choose another one")
        if not name or any(c in name for c in ",:@= \t\n"):
            raise UsageError(f"behavior {name!r}: a name must not contain , : @ = or spaces")
        if not callable(constructor):
            raise UsageError(f"behavior {name!r}: register a class or a function that makes a model")
        behaviors._registered[name] = behaviors._entry(constructor, name)
        return constructor

    return register


@checked
def metric(
    name: str,
    *,
    critical: Literal["min", "max"],
    unit: str = "",
    threshold: float | None = None,
    label: str | None = None,
    inverse: bool = False,
    finite: bool = False,
) -> Callable[[F], F]:
    """Register a function of `Scenes` that returns `Samples` as a metric: ``@metric("my_metric", ...)``.

    Args:
        critical: ``min`` if small values are critical, else ``max``.
        unit: of the function's values.
        threshold: value from which a future is critical.
        inverse: aggregate 1 / value; ``critical`` and ``threshold`` refer to it.
        finite: leave infinite values out of the aggregates.

    Raises:
        UsageError: the name is taken or cannot be written on a command line, or the side is unknown.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> @scex.metric("slowest", critical="min", unit="m/s")
        ... def slowest(scenes):
        ...     first, second = scenes.pairs
        ...     return scenes.unordered(np.minimum(scenes.speed[first], scenes.speed[second]))
        >>> scex.extrapolate(scene, futures=2, metrics=["slowest"]).metrics.column_names
        ['future', 'slowest', 'slowest_mean', 'collision']
    """
    if name in METRICS or name in metrics._TAKEN:
        raise UsageError(f"metric {name!r}: the name is taken; choose another one")
    if not name or name.endswith("_mean") or any(c in name for c in ",:@=. \t\n"):
        raise UsageError(f"metric {name!r}: a name must not contain , : @ = . or spaces, nor end with _mean")
    if critical not in ("min", "max"):
        raise UsageError(f"metric {name!r}: critical={critical!r}; choose min or max")
    if threshold is not None and not math.isfinite(threshold):
        raise UsageError(f"metric {name!r}: threshold {threshold} is not a finite number")

    def register(function: F) -> F:
        registered = Metric(
            name=name,
            unit=unit,
            critical=critical,
            evaluate=function,
            inverse=inverse,
            finite=finite,
            threshold=threshold,
            label=label or "",
        )
        metrics._registered[name] = registered
        function.__scex_metric__ = registered  # type: ignore[attr-defined]
        return function

    return register
