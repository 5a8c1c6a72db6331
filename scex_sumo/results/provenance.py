"""Provenance of a result: its seed scene and the versions of packages."""

from __future__ import annotations

import hashlib
import platform
from typing import Any

import numpy as np

from scex_sumo.base.version import version_of
from scex_sumo.scene import SeedScene


def digest(scene: SeedScene) -> str:
    """Return the SHA-256 of everything in a seed scene that its children depend on."""
    digest = hashlib.sha256()
    for array in (scene.track_ids, scene.length, scene.width):
        digest.update(np.ascontiguousarray(array).tobytes())
    for states in (scene.history, scene.future, scene.obstacles.states if scene.obstacles else None):
        if states is not None:
            for array in (states.x, states.y, states.heading, states.speed):
                digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr(scene.types).encode())
    for lane in scene.road.lanes.values() if scene.road is not None else ():
        digest.update(repr((lane.lane_id, lane.kind, lane.speed_limit_mps, lane.successors)).encode())
        digest.update(np.ascontiguousarray(lane.centreline).tobytes())
    return digest.hexdigest()


def describe(scene: SeedScene) -> dict[str, Any]:
    """Return the seed scene's entry of ``run.json``."""
    return {
        "name": scene.name,
        "location": scene.location,
        "time_s": scene.time_s,
        "vehicles": scene.vehicles,
        "track_ids": [int(t) for t in scene.track_ids],
        "obstacles": len(scene.obstacles.ids) if scene.obstacles is not None else 0,
        "recorded_future_steps": int(scene.future.shape[1]) if scene.future is not None else 0,
        "notes": list(scene.notes),
        "source": scene.source,
        "map": str(scene.road.file) if scene.road is not None and scene.road.file is not None else None,
        "origin": list(scene.road.origin) if scene.road is not None else None,
        "fingerprint": digest(scene),
    }


def versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers depend on."""
    names = ("libsumo", "eclipse-sumo", "lanelet2", "numpy", "scipy", "shapely", "pyarrow")
    return {"python": platform.python_version(), **{n: version_of(n) for n in names}}
