"""Observation of an agent: the inputs of a driver model, and the path ahead, as named or flat arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.projection import sample_paths
from scex_sumo.scene import States

PATH_POINTS, PATH_SPACING_M = 10, 3.0  # of the agent's path ahead
MAX_OBSERVED = 1000.0  # m, m/s; larger values are cut
Observation: TypeAlias = NDArray[np.float32] | dict[str, NDArray[np.float32]]


def path_ahead(paths: SeedPaths, row: IntArray, way: FloatArray, now: States) -> FloatArray:
    """Return (N, 10, 2) points of paths ahead of agents, in their frames, m.

    Args:
        row: (N,) paths; ``way`` (N,) arc lengths of the agents on them, m.
    """
    ahead = PATH_SPACING_M * np.arange(1, PATH_POINTS + 1)
    s = (way[:, None] + ahead).ravel()
    x, y = sample_paths(paths, np.repeat(row, PATH_POINTS), s)[:2].reshape(2, -1, PATH_POINTS)
    dx, dy = x - now.x[:, None], y - now.y[:, None]
    cos, sin = np.cos(now.heading)[:, None], np.sin(now.heading)[:, None]
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=-1)


def observed(arrays: Mapping[str, FloatArray], *, flat: bool) -> Observation:
    """Return the observation of N agents by their named arrays; ``flat`` as `gymnasium.spaces.flatten`."""
    if not flat:
        return {name: _cut(values.astype(np.float32)) for name, values in arrays.items()}
    return _cut(
        np.concatenate(
            [arrays[name].reshape(len(arrays[name]), -1) for name in sorted(arrays)],
            axis=1,
            dtype=np.float32,
            casting="same_kind",
        )
    )


def _cut(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.clip(values, -MAX_OBSERVED, MAX_OBSERVED, out=values)
