"""Frames of vehicles: states as they see them, origin at its centre now, x ahead, y to the left."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.scene import States

SEEN_COLUMNS = ("x", "y", "cos", "sin", "speed")


def seen_from(now: States, states: States) -> FloatArray:
    """States in the frames of vehicles.

    Args:
        now: (n...,) where the vehicles are.
        states: (n..., k...) what each of them looks at.

    Returns:
        (n..., k..., 5): x and y in m, cosine and sine of the heading relative to the vehicle's, speed in m/s.
    """
    frame = (..., *(None,) * (len(states.shape) - len(now.shape)))
    cos, sin = np.cos(now.heading)[frame], np.sin(now.heading)[frame]
    dx, dy = states.x - now.x[frame], states.y - now.y[frame]
    turn = states.heading - now.heading[frame]
    seen = np.empty((*states.shape, len(SEEN_COLUMNS)))
    seen[..., 0] = cos * dx + sin * dy
    seen[..., 1] = cos * dy - sin * dx
    seen[..., 2], seen[..., 3] = np.cos(turn), np.sin(turn)
    seen[..., 4] = states.speed
    return seen
