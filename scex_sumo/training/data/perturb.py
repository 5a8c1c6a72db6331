"""Copies of a scene in which vehicles are a little off the place and direction they were recorded with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import States


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """How far vehicles are put off, uniformly up to both sides.

    Attributes:
        lateral_m: sideways.
        heading_rad: turned.
        share: of the vehicles of a copy that are put off; the others stay.
    """

    lateral_m: float = 0.7
    heading_rad: float = float(np.deg2rad(5.0))
    share: float = 1.0


def perturbed(history: States, perturbation: Perturbation, rng: np.random.Generator) -> States:
    """Put vehicles off, each with its whole past, so that the past agrees with the present.

    Args:
        history: (V, T), the last column is the present.

    Returns:
        (V, T); speeds stay.
    """
    count = history.shape[0]
    off = rng.random(count) < perturbation.share
    lateral = off * rng.uniform(-perturbation.lateral_m, perturbation.lateral_m, count)
    turn = off * rng.uniform(-perturbation.heading_rad, perturbation.heading_rad, count)
    return moved(history, lateral, turn)


def moved(history: States, lateral: FloatArray, turn: FloatArray) -> States:
    """Shift tracks to the left of their present heading and turn them about their present place.

    Args:
        history: (V, T), the last column is the present.
        lateral: (V,) m.
        turn: (V,) rad.
    """
    now = history[:, -1]
    x = now.x - lateral * np.sin(now.heading)
    y = now.y + lateral * np.cos(now.heading)
    dx, dy = history.x - now.x[:, None], history.y - now.y[:, None]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return States(
        x=x[:, None] + cos * dx - sin * dy,
        y=y[:, None] + sin * dx + cos * dy,
        heading=wrap(history.heading + turn[:, None]),
        speed=history.speed.copy(),
    )
