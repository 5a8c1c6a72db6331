"""Runs of tests: without human-like reference, critical responses and page, unless a test asks for them."""

from __future__ import annotations

from typing import Any

import scex_sumo
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene


def extrapolate(scene: SeedScene, **options: Any) -> Run:
    """Extrapolate as `scex_sumo.extrapolate`."""
    return scex_sumo.extrapolate(scene, **{"reference": None, "report": False, **options})
