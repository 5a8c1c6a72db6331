"""Metrics of users: a decorator that registers a function."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, TypeVar

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics import registry
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes
from scex_sumo.metrics.registry import OURS, TAKEN, Metric

F = TypeVar("F", bound=Callable[[Scenes], Samples | Entries])


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
    if name in OURS or name in TAKEN:
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
            critical=critical,
            evaluate=function,
            unit=unit,
            inverse=inverse,
            finite=finite,
            threshold=threshold,
            label=label or "",
        )
        registry._registered[name] = registered
        function.__scex_metric__ = registered  # type: ignore[attr-defined]
        return function

    return register
