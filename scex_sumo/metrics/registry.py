"""The metrics by name, and the presets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from scex_sumo.errors import UsageError
from scex_sumo.metrics.distance import distance
from scex_sumo.metrics.drac import drac
from scex_sumo.metrics.gap_time import gap_time
from scex_sumo.metrics.outlines.gap import gap
from scex_sumo.metrics.outlines.wttc_path import wttc_path
from scex_sumo.metrics.pairs.by_heading import following_by_heading
from scex_sumo.metrics.pairs.on_path import following_on_path
from scex_sumo.metrics.pairs.scenes import Metric, Preset
from scex_sumo.metrics.pet import pet
from scex_sumo.metrics.pttc import pttc
from scex_sumo.metrics.thw import thw
from scex_sumo.metrics.tq import tq
from scex_sumo.metrics.ttc import ttc
from scex_sumo.metrics.wttc import wttc

METRICS: Final[Mapping[str, Metric]] = {
    "distance": Metric(name="distance", unit="m", critical="min", evaluate=distance),
    "tq": Metric(name="tq", unit="", critical="max", evaluate=tq),
    "gap_time": Metric(name="gap_time", unit="s", critical="min", evaluate=gap_time),
    "pttc": Metric(name="pttc", unit="s", critical="min", evaluate=pttc, finite=True, harmonic=True),
    "wttc": Metric(name="wttc", unit="s", critical="min", evaluate=wttc),
    "ttc": Metric(name="ttc", unit="s", critical="max", evaluate=ttc, inverse=True),
    "drac": Metric(name="drac", unit="m/s²", critical="max", evaluate=drac),
    "thw": Metric(name="thw", unit="s", critical="min", evaluate=thw),
    "pet": Metric(name="pet", unit="s", critical="min", evaluate=pet),
    "gap": Metric(name="gap", unit="m", critical="min", evaluate=gap),
    "wttc_path": Metric(name="wttc_path", unit="s", critical="min", evaluate=wttc_path),
}
"""Every metric; the first six are the paper's, in the order of the result columns."""

PAPER_METRICS: Final[tuple[str, ...]] = tuple(METRICS)[:6]

PRESETS: Final[Mapping[str, Preset]] = {
    "paper": Preset(name="paper", leaders=following_by_heading, conflict_area=False),
    "path": Preset(name="path", leaders=following_on_path, conflict_area=True),
}


def preset_named(name: str) -> Preset:
    """A preset by name."""
    if name not in PRESETS:
        raise UsageError(f"metrics: unknown preset {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]


def metrics_named(names: Sequence[str | Metric] | None) -> list[Metric]:
    """Metrics by name; the paper's six where none are named."""
    for name in names or ():
        if isinstance(name, str) and name not in METRICS:
            raise UsageError(f"metrics: unknown metric {name!r}; known: {', '.join(METRICS)}")
    chosen = PAPER_METRICS if names is None else names
    return [name if isinstance(name, Metric) else METRICS[name] for name in chosen]
