"""Graph Predictor: motion along the path, learned from recordings, from the semantic scene graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.behaviors.learned.extra import check_libraries
from scex_sumo.behaviors.learned.profiles import GraphPredictorProfile, weights_file
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.learned.driver import LearnedDriver


class GraphPredictor:
    """Drives along its path with the accelerations and the offset that a graph network predicts.

    The network sees all vehicles with their last second, related by the lanes, the path ahead and who is on
    it. Vehicles off the map are left to the path-following driver.
    """

    def __init__(self, profile: GraphPredictorProfile) -> None:
        check_libraries("graph_predictor")
        self.profile = profile
        self.driver.meta  # noqa: B018  unusable weights are said before anything runs

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.behaviors.learned.driver import LearnedDriver

        file = weights_file("graph_predictor", self.profile.weights)
        return LearnedDriver("graph", file, self.profile, attention=1.0, free=False)

    @property
    def weights_sha256(self) -> str:
        """Of the file of weights."""
        return self.driver.sha256

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return self.driver.plan(history, road, who, rng)
