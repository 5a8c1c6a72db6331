"""The agent's actions and rewards: next state from controls or a plan, progress, comfort."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.plug_in.predictor import completed
from scex_sumo.scene import STEP_S, States

MAX_BRAKING, MAX_ACCELERATION = 8.0, 4.0  # m/s²
MAX_STEERING = 0.5  # of the front wheels, rad
WHEELBASE = 0.6  # share of the length; a common share of passenger cars


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentSteps:
    """What one action did to the agent of each of N environments.

    Attributes:
        collided: (N,) whether the agent has touched another vehicle.
        progress: (N,) m along the agent's path.
        offset: (N,) distance from the path after the action, m, left positive.
        speed: (N,) after the action, m/s.
        speed_limit: (N,) of the path, m/s.
        acceleration: (N,) mean, m/s².
        lateral: (N,) mean acceleration to the left, m/s².
        seconds: duration of the action.
    """

    collided: BoolArray
    progress: FloatArray
    offset: FloatArray
    speed: FloatArray
    speed_limit: FloatArray
    acceleration: FloatArray
    lateral: FloatArray
    seconds: float


Reward: TypeAlias = Callable[[AgentSteps], FloatArray]


def default_reward(steps: AgentSteps) -> FloatArray:
    """Return (N,) progress as a share of the speed limit, less discomfort, less 10 for a collision.

    A second at the speed limit gives 1. Accelerating by 4 m/s² for a second costs 0.16; driving 1 m beside
    the path for a second costs 0.1.
    """
    way = steps.progress / np.maximum(steps.speed_limit, 1.0)
    aside = np.minimum(np.abs(steps.offset), 10.0)
    discomfort = 0.01 * (steps.acceleration**2 + steps.lateral**2) + 0.1 * aside
    return np.asarray(way - discomfort * steps.seconds - 10.0 * steps.collided)


def controlled(now: States, length: FloatArray, action: FloatArray) -> States:
    """Return (N,) next states under (N, 2) shares of the largest acceleration or braking, and of steering.

    Kinematic bicycle whose reference point is the centre; vehicles do not reverse.
    """
    pedal, wheel = np.clip(action, -1.0, 1.0).T
    acceleration = pedal * np.where(pedal < 0, MAX_BRAKING, MAX_ACCELERATION)
    steering = wheel * MAX_STEERING
    speed = np.maximum(now.speed + acceleration * STEP_S, 0.0)
    way = (now.speed + speed) / 2 * STEP_S
    base = WHEELBASE * length
    slip = np.arctan(np.tan(steering) / 2)
    turn = way * np.sin(slip) / (base / 2)
    direction = now.heading + slip + turn / 2
    return States(
        x=now.x + way * np.cos(direction),
        y=now.y + way * np.sin(direction),
        heading=wrap(now.heading + turn),
        speed=speed,
    )


def planned(now: States, action: FloatArray) -> States:
    """Return (N, H) next states from (N, H, 2) positions in the agent's frame, m: x ahead, y to the left."""
    x, y, heading, speed = np.moveaxis(completed(np.asarray(action, dtype=np.float64)), -1, 0)
    cos, sin = np.cos(now.heading)[:, None], np.sin(now.heading)[:, None]
    return States(
        x=now.x[:, None] + cos * x - sin * y,
        y=now.y[:, None] + sin * x + cos * y,
        heading=wrap(now.heading[:, None] + heading),
        speed=speed,
    )
