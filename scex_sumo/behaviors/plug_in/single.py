"""Single-vehicle models, which plan for one vehicle at a time, such as a driving function under test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.perception import narrow_road
from scex_sumo.errors import ScexError
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, Who


@runtime_checkable
class SingleVehicleBehavior(Protocol):
    """Plans for one vehicle of one child."""

    def plan_one(
        self, history: SceneHistory, road: Road, child: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        """Plan at least 30 steps for one vehicle.

        Args:
            history: states of the vehicle's own child alone, C = 1; its own are
                ``history.states[child, vehicle]``, (11,), those of all vehicles ``history.states[child]``,
                (V, 11).
            road: the map, narrowed to the model's `radius` around the vehicle where it has one.
            child: index into the history, 0; ``history.children[child]`` is the child's number.
            vehicle: index into the seed scene.
            rng: the child's generator.

        Returns:
            (H,) states of the centre; column 0 is the next step.
        """
        ...


def _of_child(history: SceneHistory, child: int) -> SceneHistory:
    """What belongs to one child: a model can neither see the others nor pay for them."""
    own = slice(child, child + 1)
    return replace(
        history,
        states=history.states[own],
        children=history.children[own],
        route_draw=history.route_draw[own],
    )


class SingleVehicle:
    """Makes a `Behavior` of a model that plans for one vehicle at a time."""

    def __init__(self, model: SingleVehicleBehavior) -> None:
        self.model = model
        self.radius: float | None = getattr(model, "radius", None)

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Ask the model for one vehicle after the other; see `Behavior.plan`.

        Raises:
            ScexError: a plan is too short.
        """
        now = history.now
        plans = []
        alone = {c: _of_child(history, c) for c in np.unique(who.child).tolist()}
        for c, v in zip(who.child.tolist(), who.vehicle.tolist(), strict=True):
            seen = road
            if self.radius is not None:
                seen = narrow_road(road, float(now.x[c, v]), float(now.y[c, v]), self.radius)
            plans.append(self._checked(self.model.plan_one(alone[c], seen, 0, v, rng[c])))
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
