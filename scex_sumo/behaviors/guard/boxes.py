"""Boxes of a seed scene: how far apart recorded vehicles are, for pairs that touch from the beginning."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.derived import derived
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.scene import SeedScene

FAR_M = 25.0  # centres of vehicles whose boxes may touch are nearer


@derived
def box_distances(scene: SeedScene) -> FloatArray:
    """(V, V) distance of the vehicles' boxes in a seed scene, m; inf beyond 25 m of their centres."""
    now, length, width = scene.now, scene.length, scene.width
    dx, dy = now.x - now.x[:, None], now.y - now.y[:, None]
    i, j = np.nonzero(np.hypot(dx, dy) < FAR_M)
    one, two = (Rectangles.of(now[side], length[side], width[side]) for side in (i, j))
    distance = np.full(dx.shape, np.inf)
    distance[i, j] = rectangle_distance(one, two)
    return distance
