"""Learned models: Graph Predictor and Graph Image Predictor."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from scex_sumo.behaviors.base import Sight
from scex_sumo.behaviors.learned.profiles import (
    GraphImagePredictorProfile,
    GraphPredictorProfile,
    weights_file,
)
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.learned.driver import LearnedDriver


class LearnedModel:
    """A driver whose plans a network makes; vehicles off the map are left to the path-following driver.

    Attributes:
        name: of the model.
        kind: of its network, as `scex-sumo train` calls it.
        profile: its parameters.
    """

    name: ClassVar[str]
    kind: ClassVar[str]

    def __init__(self, profile: GraphPredictorProfile | GraphImagePredictorProfile) -> None:
        self.profile = profile
        self.driver.meta  # noqa: B018  unusable weights are said before anything runs

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.behaviors.learned.driver import LearnedDriver

        profile = self.profile
        return LearnedDriver(
            self.kind,
            weights_file(self.name, profile.weights),
            profile,
            attention=float(getattr(profile, "attention", 1.0)),
            free=getattr(profile, "head", "") == "free",
        )

    @property
    def weights_sha256(self) -> str:
        """Of the file of weights."""
        return self.driver.sha256

    @property
    def sight(self) -> Sight | None:
        """What decides on a plan; a path that is drawn differs between children."""
        return None if self.profile.path == "random" or self.profile.mode == "draw" else "everyone"

    def clear_of_others(self) -> LearnedModel:
        """The same driver, one that steers clear of who is beside it."""
        other = copy(self)
        other.driver = copy(self.driver)
        other.driver.clear = True
        return other

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return self.driver.plan(history, road, who, rng)


class GraphPredictor(LearnedModel):
    """Drives along its path with the accelerations and the offset that a graph network predicts.

    The network sees all vehicles with their last second, related by the lanes, the path ahead and who is on
    it.
    """

    name, kind = "graph_predictor", "graph"


class GraphImagePredictor(LearnedModel):
    """Drives the trajectory that a network predicts from the scene graph and the road seen from above.

    Accelerations along the path and an offset from it, which may leave the lane but not the road.
    """

    name, kind = "graph_image_predictor", "hybrid"
