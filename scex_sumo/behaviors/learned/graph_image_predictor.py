"""Graph Image Predictor: whole trajectories from the scene graph and the road seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from scex_sumo.behaviors.learned.extra import check_libraries
from scex_sumo.behaviors.learned.graph_predictor import check_learned, weights_file
from scex_sumo.behaviors.paths import PathChoice
from scex_sumo.errors import UsageError
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.learned.driver import LearnedDriver

HEADS = ("bounded", "free")


@dataclass(frozen=True, kw_only=True)
class GraphImagePredictorProfile:
    """Parameters of `GraphImagePredictor`.

    Attributes:
        attention: w in [0, 1]: 1 looks at the scene graph alone, 0 at the road from above alone.
        path: as in `GraphPredictorProfile`.
        mode: as in `GraphPredictorProfile`.
        head: ``bounded`` drives along the path, at the offset that the network wants, within the road and
            what a car can do; ``free`` takes the paper's free x, y trajectory as it is.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    attention: float = 0.5
    path: PathChoice | Literal["likeliest"] = "likeliest"
    mode: str = "best"
    head: str = "bounded"
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        check_learned(self)
        number = isinstance(self.attention, int | float) and not isinstance(self.attention, bool)
        if not number or not 0 <= self.attention <= 1:
            raise UsageError(f"attention: got {self.attention!r}; give a number from 0 to 1")
        if self.head not in HEADS:
            raise UsageError(f"head: got {self.head!r}; give {' or '.join(HEADS)}")


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
