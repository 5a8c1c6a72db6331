"""Learned models: Graph Predictor and Graph Image Predictor."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from scex_sumo.behaviors.base import Driver, Sight
from scex_sumo.behaviors.driving.motion import Intent
from scex_sumo.learned.profiles import Profile, weights_file
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.learned.driver import LearnedDriver


class LearnedModel(Driver):
    """A model with a network; the path-following driver plans for vehicles off the map."""

    name: ClassVar[str]
    kind: ClassVar[str]  # of its network, as in `scex-sumo train`

    def __init__(self, profile: Profile) -> None:
        self.profile = profile
        self.driver.meta  # noqa: B018  reports unusable weights before the run begins

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.learned.driver import LearnedDriver

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
        """SHA-256 of the weights."""
        return self.driver.sha256

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on; a drawn path or mode differs between futures."""
        return None if self.profile.path == "random" or self.profile.mode == "draw" else "everyone"

    def keep_images(self) -> None:
        """Keep features of map images in the user's cache."""
        self.driver.keeps = True

    def clear_of_others(self) -> LearnedModel:
        """Return a copy that steers away from vehicles beside it."""
        other = copy(self)
        other.driver = copy(self.driver)
        other.driver.clear = True
        return other

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent | None:
        """Return the drive of these vehicles along their paths; None if some need another plan."""
        return self.driver.intend(history, road, vehicles)

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        return self.driver.plan(history, road, vehicles, rng)


class GraphPredictor(LearnedModel):
    """Drives along its path with accelerations and offsets of a graph network."""

    name, kind = "graph_predictor", "graph"


class GraphImagePredictor(LearnedModel):
    """Drives with accelerations and offsets of a network of scene graph and road image."""

    name, kind = "graph_image_predictor", "hybrid"


class JointPredictor(LearnedModel):
    """Draws the next 0.5 s of all vehicles of a future together, again and again; those off the map, too."""

    name, kind = "joint_predictor", "joint"

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> None:
        """Vehicles move together: there are only plans."""

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.learned.joint import JointDriver

        return JointDriver(self.kind, weights_file(self.name, self.profile.weights), self.profile)
