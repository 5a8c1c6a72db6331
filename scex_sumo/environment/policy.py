"""Policy as a driver: what was trained in an environment drives vehicles of runs and of test suites."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import PLAN_STEPS, Driver
from scex_sumo.behaviors.driving.paths import chosen_paths, path_positions
from scex_sumo.environment.agent import controlled, finite_numbers, observed, one_of, path_ahead, planned
from scex_sumo.plug_in.inputs import Surroundings, predictor_inputs
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex


class PolicyDriver(Driver):
    """Driver that asks a policy of `SeedVectorEnv`; its action is held until the next plan.

    Args:
        policy: a function of the observations of n agents that returns their actions, or an object with
            ``predict``, as those of Stable-Baselines3, which is asked for its deterministic action.
        action: as of the environment, like the next three; positions of a ``plan`` reach to the next plan
            at least.
    """

    def __init__(
        self,
        policy: Callable[[Any], Any] | Any,
        *,
        action: Literal["control", "plan"] = "control",
        observation: Literal["flat", "dict"] = "flat",
        path: int = 0,
        surroundings: Surroundings | None = None,
    ) -> None:
        if not callable(policy) and not hasattr(policy, "predict"):
            kind = type(policy).__name__
            raise UsageError(f"policy: got {kind}, needs a function or an object with predict")
        self._policy, self._path = policy, path
        self._controls = one_of("action", action, ("control", "plan")) == "control"
        self._flat = one_of("observation", observation, ("flat", "dict")) == "flat"
        self._surroundings = surroundings or Surroundings(neighbours=8, lanes=16)

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        paths, chosen = chosen_paths(history, road, vehicles, self._path)
        now = history.now[vehicles.future, vehicles.vehicle]
        arc_length, _, _ = path_positions(history, vehicles, paths, chosen)
        arrays = predictor_inputs(history, road, vehicles, self._surroundings)
        seen = observed({**arrays, "path": path_ahead(paths, chosen, arc_length, now)}, flat=self._flat)
        actions = self._action(seen)
        if not self._controls:
            return _continued(planned(now, _checked(actions, (len(arc_length), *np.shape(actions)[1:2], 2))))
        shares, states = _checked(actions, (len(arc_length), 2)), [now]
        for _ in range(PLAN_STEPS):
            states.append(controlled(states[-1], history.scene.length[vehicles.vehicle], shares))
        return Plan(**vars(States.stack(states[1:], axis=1)))

    def _action(self, seen: Any) -> Any:
        if hasattr(self._policy, "predict"):
            return self._policy.predict(seen, deterministic=True)[0]
        return self._policy(seen)


def _checked(actions: Any, shape: tuple[int, ...]) -> FloatArray:
    return finite_numbers("actions of the policy", actions, shape)


def _continued(states: States) -> Plan:
    """Return a plan of (n, H) states that go on with the last speed and heading."""
    last, steps = states[:, -1], np.arange(1, PLAN_STEPS - states.shape[1] + 1)
    speed = np.repeat(last.speed[:, None], len(steps), axis=1)
    more = last.ahead(speed * STEP_S * steps, speed)
    return Plan(**vars(States.concatenate([states, more], axis=1)))
