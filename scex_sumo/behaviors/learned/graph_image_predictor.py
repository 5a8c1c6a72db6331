"""Graph Image Predictor: whole trajectories from the scene graph and the road seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.behaviors.learned.extra import check_libraries
from scex_sumo.behaviors.learned.profiles import GraphImagePredictorProfile, weights_file
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.learned.driver import LearnedDriver


class GraphImagePredictor:
    """Drives the trajectory that a network predicts from the scene graph and the road seen from above.

    Accelerations along the path and an offset from it, which may leave the lane but not the road. Vehicles
    off the map are left to the path-following driver.
    """

    def __init__(self, profile: GraphImagePredictorProfile) -> None:
        check_libraries("graph_image_predictor")
        self.profile = profile
        self.driver.meta  # noqa: B018  unusable weights are said before anything runs

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.behaviors.learned.driver import LearnedDriver

        profile = self.profile
        file = weights_file("graph_image_predictor", profile.weights)
        free = profile.head == "free"
        return LearnedDriver("hybrid", file, profile, attention=float(profile.attention), free=free)

    @property
    def weights_sha256(self) -> str:
        """Of the file of weights."""
        return self.driver.sha256

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return self.driver.plan(history, road, who, rng)
