"""Fallback planner: who has no usable plan of its own model is driven by the path-following driver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.arrays import BoolArray, IntArray
from scex_sumo.behaviors.base import BY_ITSELF, PLAN_STEPS, Behavior
from scex_sumo.behaviors.models.path_follower import follow_path
from scex_sumo.behaviors.plug_in.single import SingleVehicle
from scex_sumo.behaviors.plug_in.usable import checked_shape, reason_in_model, where_from, wrong_with
from scex_sumo.errors import ScexError
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, Who

Answer = tuple[Plan, list[str], BoolArray]  # plans, what is wrong with each, whether it is to be replaced


class Fallible:
    """Asks a model, and lets the path-following driver plan for vehicles that it has no usable plan for.

    A plan is unusable where the model raises, is too short, is not finite, or jumps (see `wrong_with`). A
    call that raises is made again child by child, then vehicle by vehicle, so that who falls back does not
    depend on which children share a batch.
    """

    def __init__(self, model: Behavior, name: str) -> None:
        """Stand in for a model.

        Args:
            name: what the user calls it, for messages.
        """
        self.model = model
        self.name = name

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """The model's plan with `Plan.fallback` and `Plan.reasons`; see `Behavior.plan`."""
        made, reasons, bad = self._ask(history, road, who, rng)
        if bad.any():
            made.assign(bad, follow_path(history, road, who[bad]))
        return replace(made, fallback=np.array([r != "" for r in reasons], bool), reasons=tuple(reasons))

    def try_on(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> None:
        """Raise a `ScexError` where the model has no usable plan for any of these vehicles."""
        made = self.plan(history, road, who, rng)
        if len(who) == 0 or made.fallback is None or not made.fallback.all():
            return
        raise ScexError(
            f"{self.name}: no usable plan for any of {len(who)} vehicles of the seed scene: "
            f"{made.reasons[0]}; it is {where_from(self.model)}; needs a Plan of x, y, heading, speed, "
            f"each (n, {PLAN_STEPS}) or more steps, finite, in m and rad of the map, starting at the vehicle"
        )

    def _ask(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Answer:
        if isinstance(self.model, SingleVehicle) and len(who) > 1:  # it goes from one to the next anyway
            return self._ask_each(history, road, who, np.arange(len(who)), rng)
        asked = np.unique(who.child).tolist() if len(who) > 1 else []
        before = [rng[child].bit_generator.state for child in asked]
        try:
            made = checked_shape(self.model.plan(history, road, who, rng), len(who))
            wrong = wrong_with(made, history, who)
        except (Exception, SystemExit) as error:  # whatever a user's code raises
            if len(who) == 1:
                return _blank(1), [reason_in_model(error)], np.ones(1, dtype=np.bool_)
            for child, state in zip(asked, before, strict=True):
                rng[child].bit_generator.state = state
            parts = np.unique(who.child, return_inverse=True)[1] if len(asked) > 1 else np.arange(len(who))
            return self._ask_each(history, road, who, parts, rng)
        own = made.reasons or (BY_ITSELF,) * len(who)
        fell = np.zeros(len(who), bool) if made.fallback is None else made.fallback
        reasons = [w or (o if f else "") for w, o, f in zip(wrong, own, fell, strict=True)]
        return made, reasons, np.array([w != "" for w in wrong], bool)

    def _ask_each(
        self, history: SceneHistory, road: Road, who: Who, part: IntArray, rng: Sequence[np.random.Generator]
    ) -> Answer:
        """Ask for some of the vehicles after the others: those with equal numbers in (n,) `part` together."""
        count = len(who)
        whole = _blank(count)
        reasons, bad = [""] * count, np.zeros(count, dtype=np.bool_)
        for number in range(int(part.max()) + 1):
            at = np.flatnonzero(part == number)
            made, why, bad[at] = self._ask(history, road, who[at], rng)
            whole.assign(at, made)
            for index, reason in zip(at.tolist(), why, strict=True):
                reasons[index] = reason
        return whole, reasons, bad


def _blank(count: int) -> Plan:
    return Plan(**vars(States.empty((count, PLAN_STEPS)).map(np.zeros_like)))
