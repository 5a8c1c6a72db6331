"""Emergency brake: braking along the path to a standstill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.behaviors.base import Sight
from scex_sumo.behaviors.driving.paths import PathChoice, chosen_paths
from scex_sumo.behaviors.driving.together import Intent, driven
from scex_sumo.behaviors.parameters import check_path, check_positive
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who


@dataclass(frozen=True, kw_only=True)
class EmergencyBrakeProfile:
    """Parameters of `EmergencyBrake`.

    Attributes:
        deceleration: m/s², positive.
        path: which path to take, as in `IdmProfile`.
    """

    deceleration: float = 5.0
    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_positive(self, "deceleration")
        check_path(self.path)


class EmergencyBrake:
    """Brakes to a standstill along its path: it stops after v² / (2·deceleration)."""

    def __init__(self, profile: EmergencyBrakeProfile) -> None:
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
        braking = np.full(len(who), -self.profile.deceleration)
        return Intent(who=who, paths=paths, row=row, accelerate=lambda *_: braking)
