"""Single-vehicle models, which plan for one vehicle at a time, e.g. a driving function under test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, VehicleIndex


@runtime_checkable
class SingleVehicleBehavior(Protocol):
    """A model that plans for one vehicle of one child."""

    def plan_one(
        self, history: SceneHistory, road: Road, child: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        """Plan at least 30 steps for one vehicle.

        Args:
            history: states of the vehicle's child alone. ``history.states[child, vehicle]`` (11,) are the
                vehicle's, ``history.states[child]`` (V, 11) those of all.
            road: the map; if the model has a `radius`, only the part around the vehicle.
            child: index into the history, 0; ``history.children[child]`` is the child's number.

        Returns:
            (H,) states of the centre; column 0 is the next step.
        """
        ...


class SingleVehicle:
    """Adapter that makes a `Behavior` of a single-vehicle model."""

    def __init__(self, model: SingleVehicleBehavior) -> None:
        self.model = model
        self.radius: float | None = getattr(model, "radius", None)

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Ask the model for one vehicle after the other; see `Behavior.plan`."""
        now = history.now
        plans = []
        alone = {c: _child_history(history, c) for c in np.unique(who.child).tolist()}
        for c, v in zip(who.child.tolist(), who.vehicle.tolist(), strict=True):
            visible = road
            if self.radius is not None:
                visible = narrow_road(road, float(now.x[c, v]), float(now.y[c, v]), self.radius)
            plans.append(self._checked(self.model.plan_one(alone[c], visible, 0, v, rng[c])))
        if not plans:
            return Plan(**vars(States.empty((0, PLAN_STEPS))))
        steps = min(len(plan.x) for plan in plans)
        return Plan(**vars(States.stack([plan[:steps] for plan in plans], axis=0)))

    def _checked(self, plan: States) -> States:
        shapes = [np.shape(part) for part in vars(plan).values()]
        if any(len(shape) != 1 or shape[0] < PLAN_STEPS for shape in shapes):
            raise ScexError(
                f"behaviour model {type(self.model).__name__}: plan_one returned shapes {shapes}, "
                f"needs four of at least ({PLAN_STEPS},)"
            )
        return plan


def _child_history(history: SceneHistory, child: int) -> SceneHistory:
    only = slice(child, child + 1)
    return replace(
        history,
        states=history.states[only],
        children=history.children[only],
        route_draw=history.route_draw[only],
    )


def narrow_road(road: Road, x: float, y: float, radius: float) -> Road:
    """Return the lanes, markings and areas with a point within a radius of (x, y), m."""

    def near(points: FloatArray) -> bool:
        return bool(len(points) and (np.hypot(points[:, 0] - x, points[:, 1] - y) <= radius).any())

    lanes = {
        i: lane
        for i, lane in road.lanes.items()
        if near(lane.centreline) or near(lane.left_bound) or near(lane.right_bound)
    }
    return replace(
        road,
        lanes=lanes,
        regulations=tuple(r for r in road.regulations if any(i in lanes for i in r.lanes)),
        markings=tuple(m for m in road.markings if near(m.points)),
        areas=tuple(a for a in road.areas if near(a.outline)),
    )
