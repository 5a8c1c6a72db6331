"""User models: classes, functions and objects with their parameters; models of a single vehicle."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.behaviors.base import PLAN_STEPS, SingleVehicleBehavior, driven_by_sumo
from scex_sumo.behaviors.objects import signature_of
from scex_sumo.behaviors.spec import EMPTY, ModelEntry
from scex_sumo.plug_in.inputs import Surroundings
from scex_sumo.plug_in.predictor import INPUTS, Predictor, name_of, wanted_inputs
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, VehicleIndex


def user_model(given: Any, name: str) -> ModelEntry:
    """Return a class, function or object as a model.

    A function with inputs of a predictor, such as ``history``, predicts; another one makes the model, as does
    a class. An object with ``plan`` or ``plan_one`` is the model.
    """
    if not inspect.isclass(given):
        if hasattr(given, "__scex_predictor__"):
            return given.__scex_predictor__  # type: ignore[no-any-return]
        if hasattr(given, "plan") or hasattr(given, "plan_one"):
            own, words = not driven_by_sumo(given), _summary(given)  # SUMO's plans never fail
            return ModelEntry(make=lambda: given, summary=words, takes_guard=own, may_fail=own, is_own=own)
        if is_predictor(given):
            return predictor_model(given)
    if not callable(given):
        needs = "needs a class with plan or plan_one, or a function of history"
        raise UsageError(f"{name}: has type {type(given).__name__}; {needs}")
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = {key: p.default for key, p in signature_of(given).items() if p.kind in by_name}
    return ModelEntry(make=given, parameters=parameters, summary=_summary(given))


def predictor_model(
    function: Callable[..., Any], *, batched: bool = False, **surroundings: Any
) -> ModelEntry:
    """Return a function that predicts as a model.

    Its parameters with a default that are no inputs become parameters, as do the fields of `Surroundings`.

    Args:
        surroundings: fields of `Surroundings` with another default.
    """
    around = asdict(Surroundings(**surroundings))
    others = (p for p in signature_of(function).values() if p.name not in INPUTS)
    defaults = {p.name: p.default for p in others if p.default is not EMPTY}

    def make(**given: Any) -> Predictor:
        options = {name: given.pop(name) for name in defaults if name in given}
        return Predictor(
            partial(function, **options) if options else function,
            inputs=wanted_inputs(function),
            batched=batched,
            surroundings=Surroundings(**(around | given)),
        )

    summary = _summary(function) if function.__doc__ else f"Predictor {name_of(function)}"
    return ModelEntry(make=make, parameters=defaults | around, summary=summary)


def is_predictor(given: Any) -> bool:
    """Return whether an object is a function of a vehicle's inputs."""
    parameters = {} if inspect.isclass(given) or not callable(given) else signature_of(given)
    return any(p.name in INPUTS and p.default is EMPTY for p in parameters.values())


def _summary(given: Any) -> str:
    words = (inspect.getdoc(given) or "").strip().splitlines()
    return words[0] if words else "registered"


class SingleVehicle:
    """Adapter that makes a `BatchBehavior` of a single-vehicle model."""

    def __init__(self, model: SingleVehicleBehavior) -> None:
        self.model = model

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Ask the model for one vehicle after the other; see `BatchBehavior.plan`."""
        plans = []
        alone = {c: history.part(slice(c, c + 1)) for c in np.unique(vehicles.future).tolist()}
        for c, v in zip(vehicles.future.tolist(), vehicles.vehicle.tolist(), strict=True):
            plans.append(self.model.plan_one(alone[c], road, 0, v, rng[c]))
            shapes = [np.shape(values) for values in vars(plans[-1]).values()]
            if any(len(shape) != 1 or shape[0] < PLAN_STEPS for shape in shapes):
                what = f"behaviour model {type(self.model).__name__}: plan_one returned shapes {shapes}"
                raise ScexError(f"{what}, needs four of at least ({PLAN_STEPS},)")
        if not plans:
            return Plan(**vars(States.empty((0, PLAN_STEPS))))
        steps = min(len(plan.x) for plan in plans)
        return Plan(**vars(States.stack([plan[:steps] for plan in plans], axis=0)))
