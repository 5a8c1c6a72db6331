"""Behaviour model: the protocol that all of them follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

PLAN_STEPS = 30
Sight: TypeAlias = Literal["itself", "everyone"]
"""What decides on a vehicle's plan, beside the seed scene, the map and the step: its own states, or all.

A model of ours says so in an attribute ``sight``; None, or no such attribute, is one that draws as well.
"""
BY_ITSELF = "had no plan of its own"  # why a model fell back, where it does not say


@runtime_checkable
class Behavior(Protocol):
    """A behaviour model: pure, batched over vehicles and children.

    ``plan`` gets everything it may depend on as arguments and changes none of it. It is called once per
    model and replan, for all its vehicles in all children of the batch.
    """

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan at least 30 steps for the vehicles in ``who``.

        Args:
            history: states now and 10 steps back, as read from SUMO.
            road: the map.
            who: the n vehicles to plan for.
            rng: (C,) one generator per child of the batch; draw for a vehicle from its own child's only,
                or the result would depend on which children share a batch.
        """
        ...
