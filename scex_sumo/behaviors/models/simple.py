"""Simple models: constant velocity, emergency brake, replay of the recorded future."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import PLAN_STEPS, Driver, Sight, check_path, check_positive
from scex_sumo.behaviors.driving.motion import DrivesAlong, Intent, drive_along
from scex_sumo.behaviors.driving.paths import PathChoice, chosen_paths
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

RELEASE_MPS2 = 2.0  # acceleration after a curve, back to the constant speed


@dataclass(frozen=True, kw_only=True)
class ConstantVelocityProfile:
    """Parameters of `ConstantVelocity`; ``path`` as in `IdmProfile`."""

    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_path(self.path)


class ConstantVelocity(DrivesAlong):
    """Drives along its path at its speed in the seed scene."""

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        paths, row = chosen_paths(history, road, vehicles, self.profile.path)
        target = np.maximum(history.scene.now.speed[vehicles.vehicle], 0.0)
        # Zero but for rounding, unless a curve changed the speed before.
        limit = RELEASE_MPS2 if paths.slow_in_curves else np.inf
        return Intent(vehicles, paths, row, lambda _, v, *__: np.minimum((target - v) / STEP_S, limit))


@dataclass(frozen=True, kw_only=True)
class EmergencyBrakeProfile:
    """Parameters of `EmergencyBrake`: deceleration in m/s², and ``path`` as in `IdmProfile`."""

    deceleration: float = 5.0
    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_positive(self, "deceleration")
        check_path(self.path)


class EmergencyBrake(DrivesAlong):
    """Brakes to a standstill along its path."""

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        paths, row = chosen_paths(history, road, vehicles, self.profile.path)
        braking = np.full(len(vehicles), -self.profile.deceleration)
        return Intent(vehicles, paths, row, lambda *_: braking)


class Replay(Driver):
    """Repeats the recorded future, then keeps the last speed along its straightest path."""

    sight: Sight = "itself"

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`. `UsageError`: the seed scene has no recorded future."""
        scene = history.scene
        if scene.future is None or scene.future_valid is None:
            missing = f"replay: seed scene {scene.name} has no recorded future"
            raise UsageError(f"{missing}; choose other models or a recorded seed")
        # up to the first gap
        valid = np.cumprod(scene.future_valid, axis=1).sum(axis=1)[vehicles.vehicle]
        left = np.clip(valid - history.step, 0, PLAN_STEPS)  # (n,) recorded steps from now on
        recorded = scene.future[vehicles.vehicle]
        i, h, steps = np.arange(len(vehicles)), np.arange(PLAN_STEPS), recorded.shape[1] - 1
        last = np.clip(history.step + left - 1, 0, steps)
        ends = [recorded[i, last], history.now[vehicles.future, vehicles.vehicle]]
        end = States.joined(ends, lambda parts: np.where(left > 0, *parts))
        planned = recorded[:, np.minimum(history.step + h, steps)]
        ending = np.flatnonzero(left < PLAN_STEPS)
        rest = drive_along(history, road, vehicles[ending], "straight", start=end[ending])
        index, step = np.nonzero(h >= left[ending, None])
        planned.assign((ending[index], step), rest[index, step - left[ending[index]]])
        return Plan(**vars(planned))
