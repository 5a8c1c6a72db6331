"""SUMO's own car-following models as models of vehicles: their routes and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.sumo.car_following import OWN_MODEL, SUMO_MODELS, check_driver
from scex_sumo.behaviors.base import Driver, Sight, check_path
from scex_sumo.behaviors.driving.motion import drive_along
from scex_sumo.behaviors.driving.paths import PathChoice, seed_paths
from scex_sumo.road import Road
from scex_sumo.roads.routes import extended
from scex_sumo.scene import Plan, SceneHistory, SeedScene, VehicleIndex

ROUTE_M = 500.0  # of the routes for SUMO


class SumoDriver(Driver):
    """A SUMO car-following model: the world leaves the vehicle to SUMO, this class gives its route.

    Attributes:
        model: SUMO's name of the model, e.g. ``EIDM``; ``own`` for each vehicle's own in a SUMO simulation.
        parameters: attributes of SUMO's vehicle types, e.g. ``{"tau": "1.2"}``.
        path: index from left to right, ``straight`` or ``random``.

    Raises:
        UsageError: SUMO has no such model or parameter, or its result would depend on the tile.
    """

    by_sumo = True

    def __init__(
        self, model: str, parameters: Mapping[str, str] | None = None, *, path: PathChoice = "straight"
    ) -> None:
        self.model = model
        self.parameters = dict(parameters or {})
        self.path = path
        check_driver(model, self.parameters)
        check_path(path)

    def routes(
        self, scene: SeedScene, road: Road, vehicle: IntArray, draw: FloatArray
    ) -> list[tuple[int, ...]]:
        """Return the lane ids of routes; empty off the mapped lanes.

        ``vehicle``: (n,) index into the seed scene; ``draw``: (n,) `SceneHistory.route_draw`.
        """
        paths = seed_paths(scene, road)
        rows = paths.choose(self.path, vehicle, draw).tolist()
        lanes = {row: paths.lanes[row] for row in {*rows}}
        whole = {row: extended(road, known, ROUTE_M) if known else () for row, known in lanes.items()}
        return [whole[row] for row in rows]

    def driving(self, scene: SeedScene, vehicle: int) -> tuple[str, dict[str, str]]:
        """Return SUMO's model and its parameters for a vehicle: those of its own type, then the given ones.

        `UsageError`: ``own``, and the scene is not of a SUMO simulation.
        """
        intention = scene.intention(vehicle)
        if intention is None and self.model == OWN_MODEL:
            raise UsageError(
                f"sumo:{OWN_MODEL}: vehicle {scene.track_ids[vehicle]} is not of a SUMO simulation; "
                f"name a model, one of {', '.join(SUMO_MODELS)}"
            )
        if intention is None:
            return self.model, self.parameters
        own = intention.model if intention.model in SUMO_MODELS else SUMO_MODELS[0]
        model = own if self.model == OWN_MODEL else self.model
        return model, {**intention.parameters, **self.parameters}

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on; a drawn path differs between futures."""
        return None if self.path == "random" else "itself"

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the expected path at the present speed, for metrics only."""
        return drive_along(history, road, vehicles, self.path)
