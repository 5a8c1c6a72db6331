"""Pairs of vehicles in straight motion, and the cases with closed forms kept outside the repository."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from scex_sumo.metrics.base import SceneTracks
from scex_sumo.scene import STEP_S
from tests.conftest import shared_data
from tests.seeds import steady


def straight(*vehicles: dict[str, float], steps: int = 60) -> SceneTracks:
    """One future without history at constant velocity; keys x, y, heading, speed, length, width."""

    def column(name: str, default: float = 0.0) -> Any:
        return np.array([v.get(name, default) for v in vehicles], dtype=float)

    motion = zip(column("x"), column("y"), column("heading"), column("speed"), strict=True)
    states = steady(*motion, time_s=np.arange(steps) * STEP_S).swapaxes(0, 1)[None]
    return SceneTracks(states=states, length=column("length", 4.0), width=column("width", 2.0))


def closed_forms() -> list[dict[str, Any]]:
    """The cases of ``oracles/outcomes.json``; skips the test where they are absent."""
    folder = shared_data()
    file = None if folder is None else folder.parent / "oracles" / "outcomes.json"
    if file is None or not file.is_file():
        pytest.skip("the closed forms are not here; set SCEX_DATA to the folder beside them")
    cases: list[dict[str, Any]] = json.loads(file.read_text())["cases"]
    return cases
