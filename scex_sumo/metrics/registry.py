"""The metrics by name, and the presets: rules for who follows whom."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from scex_sumo.errors import UsageError
from scex_sumo.metrics.base import Metric
from scex_sumo.metrics.distance import distance
from scex_sumo.metrics.following import Following, following_by_heading
from scex_sumo.metrics.gap_time import gap_time
from scex_sumo.metrics.pttc import pttc
from scex_sumo.metrics.scenes import Scenes
from scex_sumo.metrics.tq import tq
from scex_sumo.metrics.ttc import ttc
from scex_sumo.metrics.wttc import wttc

METRICS: Final[Mapping[str, Metric]] = {
    "distance": Metric(name="distance", unit="m", critical="min", evaluate=distance),
    "tq": Metric(name="tq", unit="", critical="max", evaluate=tq),
    "gap_time": Metric(name="gap_time", unit="s", critical="min", evaluate=gap_time),
    "pttc": Metric(name="pttc", unit="s", critical="min", evaluate=pttc, finite=True),
    "wttc": Metric(name="wttc", unit="s", critical="min", evaluate=wttc),
    "ttc": Metric(name="ttc", unit="s", critical="max", evaluate=ttc, inverse=True),
}
"""The six metrics of the paper, in the order of the result columns."""

PRESETS: Final[Mapping[str, Callable[[Scenes], Following]]] = {"paper": following_by_heading}
"""Who follows whom, by preset."""


def leaders_of(preset: str) -> Callable[[Scenes], Following]:
    """The rule of a preset."""
    if preset not in PRESETS:
        raise UsageError(f"metrics: unknown preset {preset!r}; known: {', '.join(PRESETS)}")
    return PRESETS[preset]


def metrics_named(names: tuple[str, ...] | None) -> list[Metric]:
    """Metrics by name; the paper's six where none are named."""
    for name in names or ():
        if name not in METRICS:
            raise UsageError(f"metrics: unknown metric {name!r}; known: {', '.join(METRICS)}")
    return [METRICS[name] for name in (names or METRICS)]
