"""Presets by name: who follows whom, and what a crossing is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from scex_sumo.errors import UsageError
from scex_sumo.metrics.pairs.by_heading import following_by_heading
from scex_sumo.metrics.pairs.on_path import following_on_path
from scex_sumo.metrics.pairs.scenes import Preset

PRESETS: Final[Mapping[str, Preset]] = {
    "paper": Preset(name="paper", leaders=following_by_heading, conflict_area=False),
    "path": Preset(name="path", leaders=following_on_path, conflict_area=True),
}


def preset_named(name: str) -> Preset:
    """A preset by name."""
    if name not in PRESETS:
        raise UsageError(f"metrics: unknown preset {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]
