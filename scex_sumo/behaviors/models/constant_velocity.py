"""Constant velocity: the speed of the seed scene along the path, whatever stands in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.behaviors.base import Sight
from scex_sumo.behaviors.driving.paths import PathChoice, chosen_paths
from scex_sumo.behaviors.driving.together import Intent, driven
from scex_sumo.behaviors.parameters import check_path
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who


@dataclass(frozen=True, kw_only=True)
class ConstantVelocityProfile:
    """Parameters of `ConstantVelocity`.

    Attributes:
        path: which path to take, as in `IdmProfile`.
    """

    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_path(self.path)


class ConstantVelocity:
    """Drives along its path at the speed it had in the seed scene."""

    def __init__(self, profile: ConstantVelocityProfile) -> None:
        self.profile = profile

    @property
    def sight(self) -> Sight | None:
        """What decides on a plan; a path that is drawn differs between children."""
        return None if self.profile.path == "random" else "itself"

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return driven(history, [self.intend(history, road, who)])[0]

    def intend(self, history: SceneHistory, road: Road, who: Who) -> Intent:
        """See `DrivesAlong`."""
        paths, row = chosen_paths(history, road, who, self.profile.path)
        target = np.maximum(history.scene.now.speed[who.vehicle], 0.0)
        # Zero but for rounding, unless something else moved the vehicle before.
        return Intent(who=who, paths=paths, row=row, accelerate=lambda _, v, *__: (target - v) / STEP_S)
