"""Scenes driven in closed loop without SUMO, and who overlaps whom in them."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import is_driven_by_sumo
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.learned.training.closed_loop import drive_all
from scex_sumo.scene import SeedScene, States


def drive_scene(scene: SeedScene, model: str, *, steps: int) -> States:
    """All vehicles of a scene by one model in closed loop: (V, steps + 1), the present first."""
    built = build(parse_models(model)[0])
    if is_driven_by_sumo(built):
        raise UsageError(f"{model}: SUMO's own drivers need SUMO")
    assert scene.road is not None
    driven = drive_all(scene, scene.road, built, steps=steps)[0].swapaxes(0, 1)
    return States.concatenate([scene.now[:, None], driven], axis=1)


def overlaps(states: States, length: FloatArray, width: FloatArray) -> BoolArray:
    """(V, V, T) whether two vehicles' rectangles overlap; never with themselves.

    Args:
        states: (V, T).
        length: (V,) m.
        width: (V,) m.
    """
    count = len(length)
    i, j = np.triu_indices(count, 1)
    reach = np.sqrt(length**2 + width**2) / 2
    dx, dy = states.x[j] - states.x[i], states.y[j] - states.y[i]
    pair, t = np.nonzero(dx**2 + dy**2 <= ((reach[i] + reach[j]) ** 2)[:, None])
    a, b = i[pair], j[pair]
    one, two = (Rectangles.of(states[side, t], length[side], width[side]) for side in (a, b))
    distance = rectangle_distance(one, two)
    result = np.zeros((count, count, states.shape[1]), dtype=np.bool_)
    hit = distance <= 0
    result[a[hit], b[hit], t[hit]] = True
    return result | result.swapaxes(0, 1)
