"""The agent's observations, actions and rewards: next state from controls or a plan, progress, comfort."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.driving.motion import map_plan
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.geometry.polylines import wrap
from scex_sumo.plug_in.predictor import completed
from scex_sumo.scene import STEP_S, Plan, States

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
    progress_s = steps.progress / np.maximum(steps.speed_limit, 1.0)
    aside = np.minimum(np.abs(steps.offset), 10.0)
    discomfort = 0.01 * (steps.acceleration**2 + steps.lateral**2) + 0.1 * aside
    return np.asarray(progress_s - discomfort * steps.seconds - 10.0 * steps.collided)


def controlled(now: States, length: FloatArray, action: FloatArray) -> States:
    """Return (N,) next states under (N, 2) shares of the largest acceleration or braking, and of steering.

    Kinematic bicycle whose reference point is the centre; vehicles do not reverse.
    """
    pedal, wheel = np.clip(action, -1.0, 1.0).T
    acceleration = pedal * np.where(pedal < 0, MAX_BRAKING, MAX_ACCELERATION)
    steering = wheel * MAX_STEERING
    speed = np.maximum(now.speed + acceleration * STEP_S, 0.0)
    distance_m = (now.speed + speed) / 2 * STEP_S
    slip = np.arctan(np.tan(steering) / 2)
    turn = distance_m * np.sin(slip) / (WHEELBASE * length / 2)
    direction = now.heading + slip + turn / 2
    return States(
        x=now.x + distance_m * np.cos(direction),
        y=now.y + distance_m * np.sin(direction),
        heading=wrap(now.heading + turn),
        speed=speed,
    )


def planned(now: States, action: FloatArray) -> Plan:
    """Return (N, H) next states from (N, H, 2) positions in the agent's frame, m: x ahead, y to the left."""
    x, y, heading, speed = np.moveaxis(completed(np.asarray(action, dtype=np.float64)), -1, 0)
    return map_plan(now, States(x=x, y=y, heading=heading, speed=speed))


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return an argument as an int; raise a `UsageError` unless it is a whole number from low to high."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= int(value) <= high:
        raise UsageError(f"{name}: got {value!r}, needs a whole number from {low} to {high:,}")
    return int(value)


def one_of(name: str, value: Any, known: Sequence[str]) -> str:
    """Return an argument; raise a `UsageError` unless it is one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise UsageError(f"{name}: unknown {value!r}; known: {', '.join(known)}")
    return value


def finite_numbers(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return values as an array; raise a `UsageError` unless they are finite real numbers of a shape."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise UsageError(f"{name}: got rows of different lengths, needs shape {shape}") from None
    if array.dtype.kind not in "fiub":
        raise UsageError(f"{name}: got values of type {array.dtype.name}, needs real numbers")
    if array.shape != shape:
        raise UsageError(f"{name}: got shape {array.shape}, needs {shape}")
    if not np.isfinite(array).all():
        raise UsageError(f"{name}: got {np.count_nonzero(~np.isfinite(array))} values that are not finite")
    return np.asarray(array, dtype=np.float64)


PATH_POINTS, PATH_SPACING_M = 10, 3.0  # of the agent's path ahead
MAX_OBSERVED = 1000.0  # m, m/s; larger values are cut
Observation: TypeAlias = NDArray[np.float32] | dict[str, NDArray[np.float32]]


def path_ahead(paths: SeedPaths, path: IntArray, arc_length: FloatArray, now: States) -> FloatArray:
    """Return (N, 10, 2) points of paths ahead of agents, in their frames, m.

    Args:
        path: (N,) paths; ``arc_length`` (N,) arc lengths of the agents on them, m.
    """
    ahead = PATH_SPACING_M * np.arange(1, PATH_POINTS + 1)
    s = (arc_length[:, None] + ahead).ravel()
    x, y = paths.at(np.repeat(path, PATH_POINTS), s)[:2].reshape(2, -1, PATH_POINTS)
    return np.stack(now.ahead_and_left(x, y), axis=-1)


def observed(arrays: Mapping[str, FloatArray], *, flat: bool) -> Observation:
    """Return the observation of N agents by their named arrays; ``flat`` as `gymnasium.spaces.flatten`."""
    if not flat:
        return {name: _cut(values.astype(np.float32)) for name, values in arrays.items()}
    rows = [arrays[name].reshape(len(arrays[name]), -1) for name in sorted(arrays)]
    return _cut(np.concatenate(rows, axis=1, dtype=np.float32, casting="same_kind"))


def _cut(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.clip(values, -MAX_OBSERVED, MAX_OBSERVED, out=values)
