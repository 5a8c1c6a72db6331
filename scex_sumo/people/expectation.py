"""Expected motion of people over the next 3 s, linear in what the seed scene shows.

Along and across the direction of the last half second: velocities over several times (their differences are
accelerations and turns), push of vehicles, push of people around, and their mean velocity, which one joins.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.scene import STEP_S, SeedScene

SHOWN_STEPS: Final = 5  # over which speed and direction are measured
OTHER_STEPS: Final = (1, 2, 10)  # over which velocities are compared with it
VEHICLE_M, PEOPLE_M, JOINED_M = 5.0, 2.0, 3.0  # over which pushes and joining decay by e
JOINED_DOUBT: Final = 0.3  # weight of nobody
LEAST_M: Final = 0.1  # distance in a direction


@owner_cache
def shown_features(scene: SeedScene) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return speeds, m/s, and directions, rad, (V,) of the last half second, and features (2, V, 6).

    The features are along and across: velocities over `OTHER_STEPS` minus the shown one, m/s; pushes of
    vehicles and of people; mean velocity of people around minus the own one, m/s.
    """
    place = scene.history.x + 1j * scene.history.y
    shown = _velocity(place, SHOWN_STEPS)
    speed = np.abs(shown)
    direction = np.where(speed > 0.1, np.angle(shown), scene.now.heading)
    turned = np.exp(-1j * direction)
    people = np.zeros(scene.vehicles, dtype=np.bool_) if scene.people is None else scene.people
    to = place[:, -1] - place[:, -1][:, None]
    apart = np.abs(to)
    away = -to / np.maximum(apart, LEAST_M)
    vehicles = (np.exp(-apart / VEHICLE_M) * away)[:, ~people].sum(axis=1)
    weight = np.where(people & (apart > 0), np.exp(-apart / PEOPLE_M), 0.0)
    near = np.where(people & (apart > 0), np.exp(-apart / JOINED_M), 0.0)
    joined = (near * (shown[None] - shown[:, None])).sum(axis=1) / (near.sum(axis=1) + JOINED_DOUBT)
    changes = [_velocity(place, steps) - shown for steps in OTHER_STEPS]
    seen = np.stack([*changes, vehicles, (weight * away).sum(axis=1), joined], axis=1) * turned[:, None]
    return speed, direction, np.stack([seen.real, seen.imag])


def _velocity(place: FloatArray, steps: int) -> FloatArray:
    """Return (V,) complex velocities over the last steps, m/s."""
    return np.asarray((place[:, -1] - place[:, -1 - steps]) / (steps * STEP_S))
