"""SUMO's own car-following models, whose vehicles drive in the same world as the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import Sight
from scex_sumo.behaviors.driving.motion import drive_along
from scex_sumo.behaviors.driving.paths import PathChoice, planned_lanes
from scex_sumo.behaviors.parameters import check_path
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, Who
from scex_sumo.sumo_models import check_driver


class SumoDriver:
    """A SUMO car-following model. The world leaves the vehicle to SUMO; this gives its route.

    Attributes:
        model: SUMO's name of the model, e.g. ``EIDM``.
        parameters: attributes of SUMO's vehicle types, e.g. ``{"tau": "1.2"}``.
        path: which path to take, as in `IdmProfile`.
    """

    def __init__(
        self, model: str, parameters: Mapping[str, str] | None = None, *, path: PathChoice = "straight"
    ) -> None:
        """Check and keep the model.

        Raises:
            UsageError: SUMO has no such model or parameter, or it would depend on the tile.
        """
        self.model = model
        self.parameters = dict(parameters or {})
        self.path = path
        check_driver(model, self.parameters)
        check_path(path)

    def routes(
        self, scene: SeedScene, road: Road, vehicle: IntArray, draw: FloatArray
    ) -> list[tuple[int, ...]]:
        """Lane ids of the routes of vehicles; empty for one off the mapped lanes.

        Args:
            vehicle: (n,) index into the seed scene.
            draw: (n,) `SceneHistory.route_draw` of these vehicles.
        """
        return planned_lanes(scene, road, self.path, vehicle, draw)

    @property
    def sight(self) -> Sight | None:
        """What decides on a plan; a path that is drawn differs between children."""
        return None if self.path == "random" else "itself"

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """The path that the vehicle is expected to take, at its present speed: for metrics only."""
        return drive_along(history, road, who, self.path)
