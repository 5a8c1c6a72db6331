"""Registry of behaviour models: names, mixes, defaults, parsing, building."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.base.importing import Registry, import_object
from scex_sumo.behaviors.base import BatchBehavior, Behavior, SingleVehicleBehavior
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmDriver
from scex_sumo.behaviors.models.simple import (
    ConstantVelocity,
    ConstantVelocityProfile,
    EmergencyBrake,
    EmergencyBrakeProfile,
    Replay,
)
from scex_sumo.behaviors.spec import ModelEntry, maker_of, parameter_value
from scex_sumo.behaviors.spec import ModelSpec as ModelSpec

DEFAULT_MODELS = "standard_driver,risky_driver,constant_velocity,emergency_brake"
SUMO: Final = "sumo"
MIXES: Final[Mapping[str, str]] = {
    "rules": DEFAULT_MODELS,
    # Without learned models, so that new weights do not change default results.
    "paper": f"{DEFAULT_MODELS},graph_predictor,graph_image_predictor",
    "violations": f"{DEFAULT_MODELS},runs_red,ignores_priority,cuts_in,drifts",
    "likely": "likely_driver",
    "people": "keeps_way",
}
"""Names that stand for several models."""

_rule = partial(ModelEntry, may_fail=False, is_own=False)  # an exception is a bug of this package

CORE: Final[Mapping[str, ModelEntry]] = {
    "calibrated_driver": _rule(
        make=IdmDriver,
        profile=CALIBRATED,
        summary="Intelligent Driver Model as people drive, slow in curves, own lane only",
        place=30,
    ),
    "constant_velocity": _rule(
        make=ConstantVelocity,
        profile=ConstantVelocityProfile(),
        summary="keeps its speed along its path, whatever is in the way",
        place=50,
    ),
    "emergency_brake": _rule(
        make=EmergencyBrake,
        profile=EmergencyBrakeProfile(deceleration=5.0),
        summary="brakes to a standstill along its path",
        place=60,
    ),
    "replay": _rule(
        make=Replay, summary="repeats the recorded future, then constant velocity along its path", place=100
    ),
}
EXTENSIONS: Final = Registry(group="scex_sumo.behaviors", kind="behavior")
"""Models of the wings and of other packages: a `ModelEntry`, or a class, function or object."""

_WEIGHED: Final = re.compile(r"(.*?@ *\d*\.?\d+)(?: *(,)(.*)| *)", re.DOTALL)

_registered: dict[str, ModelEntry] = {}


def is_own(spec: ModelSpec) -> bool:
    """Return whether a model is the user's."""
    return _entry_for(spec).is_own


def moved_by(spec: ModelSpec) -> tuple[str, ...]:
    """Return the kinds of people that a model moves; () for a model of vehicles."""
    return _entry_for(spec).moves


def known_names() -> list[str]:
    """Return the names that `build` accepts, ``sumo:<model>`` among them."""
    from scex_sumo.base.sumo.car_following import OWN_MODEL, SUMO_MODELS

    sumo = [f"{SUMO}:{model}" for model in (*SUMO_MODELS, OWN_MODEL)]
    return [*CORE, *sumo, *sorted({*_registered, *EXTENSIONS.paths} - {*CORE, SUMO, *MIXES})]


def entry_of(name: str) -> ModelEntry:
    """Return the entry of a model; raise a `UsageError` if there is none, or its package is broken."""
    if name in CORE:
        return CORE[name]
    if name.startswith(f"{SUMO}:"):
        from scex_sumo.behaviors.models.sumo import SumoDriver

        return _rule(
            make=SumoDriver,
            parameters={"path": "straight"},
            summary=f"SUMO's own {name.partition(':')[2]}; parameters are SUMO's vehicle type attributes, "
            "e.g. tau",
            takes_guard=False,
            place=200,
        )
    if name in _registered:
        return _registered[name]
    if ":" in name:
        hint = "; a model is name[:parameter=value]... or package.module:Class"
        return entry_of_object(import_object(name, hint=hint), name)
    if mix := MIXES.get(name):
        raise UsageError(
            f"{name} stands for several models and takes neither parameters nor a weight; "
            f"give them to the models: {mix}"
        )
    if name not in EXTENSIONS.paths:
        names = nearest(name, [*known_names(), *MIXES])
        raise UsageError(f"unknown behavior {name!r}; nearest: {names}; 'scex-sumo models' lists all")
    try:
        return entry_of_object(EXTENSIONS.load(name), name)
    except UsageError as error:
        raise UsageError(f"{name}: {str(error).removeprefix(f'{name}: ')}") from error


def _entry_for(spec: ModelSpec) -> ModelEntry:
    return entry_of(spec.name) if spec.model is None else entry_of_object(spec.model, spec.name)


def entry_of_object(given: Any, name: str) -> ModelEntry:
    """Return a class, function or object as a model; a `ModelEntry` itself."""
    if isinstance(given, ModelEntry):
        return given
    from scex_sumo.plug_in.user_model import user_model

    return user_model(given, name)


@checked
def parse_models(text: str) -> list[ModelSpec]:
    """Read ``name[:parameter=value]...[@weight]``, several separated by commas.

    A name may be an import path, ``package.module:Class``, or a mix: ``likely``, ``rules``, ``paper``. The
    command of ``process:`` has commas of its own; its weight, ``@2,``, ends it, or it is the last model.

    Raises:
        UsageError: a model or parameter is unknown, a weight or value is invalid, or a model is given twice.

    Example:
        >>> [str(spec) for spec in scex.parse_models("standard_driver@2,risky_driver:minimum_gap=3")]
        ['standard_driver', 'risky_driver:minimum_gap=3']
    """
    mixed = (MIXES[model].split(",") if model in MIXES else [model] for model in _parts(text))
    specs = [_parse_one(model) for parts in mixed for model in parts if model]
    if not specs:
        raise UsageError(f"no model in {text!r}; give e.g. standard_driver; 'scex-sumo models' lists all")
    _refuse_twice(specs)
    if not any(spec.weight > 0 for spec in specs):
        raise UsageError(f"all weights in {text!r} are 0; give at least one model a positive weight")
    return specs


def _parts(text: str) -> list[str]:
    """Split models at commas; one that splits its own text ends with its weight or with the text."""
    parts: list[str] = []
    rest: str | None = text
    while rest is not None:
        if _split(rest) is None:
            model, comma, after = rest.partition(",")
        elif own := _WEIGHED.fullmatch(rest):
            model, comma, after = own[1], own[2], own[3]
        else:
            model, comma, after = rest, "", ""
        parts.append(model.strip())
        rest = after if comma else None
    return parts


def model_specs(given: Any) -> tuple[ModelSpec, ...]:
    """Return the specs of a model in any form, or of a sequence of them.

    Args:
        given: text as for `parse_models`, a `ModelSpec`, or a driver: a class, a function or an object with
            ``plan`` or ``plan_one``, or a function that predicts. It stays in the spec; `label_of` names it.

    Raises:
        UsageError: it is none of these, or a model is given twice.
    """
    if isinstance(given, str):
        return tuple(parse_models(given))
    if isinstance(given, Sequence):
        specs = tuple(spec for model in given for spec in model_specs(model))
        _refuse_twice(specs)
        return specs
    if not (isinstance(given, ModelSpec | Behavior) or callable(given)):
        raise UsageError(
            f"got {reprlib.repr(given)} as a model; give its name, e.g. standard_driver, a class with plan "
            "or plan_one, an object of it, or a function of history"
        )
    spec = given
    if not isinstance(given, ModelSpec):
        from scex_sumo.behaviors.objects import label_of

        spec = ModelSpec(name=label_of(given), model=given)
    _maker(spec)  # raises for what cannot be made
    return (spec,)


def _refuse_twice(specs: Sequence[ModelSpec]) -> None:
    first: dict[str, ModelSpec] = {}
    for spec in specs:
        name = str(spec)
        if name in first:
            refuse_namesake(spec, first[name])
            raise UsageError(f"model {name} is given twice; give it once with a weight, e.g. {name}@2")
        first[name] = spec


def refuse_namesake(spec: ModelSpec, other: ModelSpec) -> None:
    """Raise a `UsageError` if two models with one name are different objects."""
    if spec.model is not other.model and spec.state != other.state:
        raise UsageError(
            f"two different models are named {spec}; name one by scex.ModelSpec(name=..., model=...)"
        )


def _split(text: str) -> tuple[str, list[str]] | None:
    """Return name and parameters if the model splits its own text, as a command with colons; else None."""
    name, colon, rest = text.partition(":")
    name = name.strip()
    if not colon or name in (*CORE, SUMO) or not name.isidentifier():
        return None
    entry = _registered.get(name) or (entry_of(name) if name in EXTENSIONS.paths else None)
    return None if entry is None or entry.split is None else (name, entry.split(rest))


def _parse_one(text: str) -> ModelSpec:
    weighed = "@" in text and (_split(text) is None or _WEIGHED.fullmatch(text))
    body, _, weight = text.rpartition("@") if weighed else (text, "", "1")
    own = _split(body)
    name, *rest = body.split(":") if own is None else (own[0], *own[1])
    if name == SUMO:
        if not rest or "=" in rest[0]:
            from scex_sumo.base.sumo.car_following import SUMO_MODELS

            raise UsageError(f"{text}: name the SUMO model, one of {', '.join(SUMO_MODELS)}, as in sumo:EIDM")
        name = f"{SUMO}:{rest.pop(0)}"
    elif (
        rest
        and all(word.isidentifier() for word in (*name.split("."), rest[0]))
        and not (name in CORE or name in _registered or name in EXTENSIONS.paths)
    ):
        name = f"{name}:{rest.pop(0)}"
    parameters = {}
    for item in rest:
        key, equals, value = item.partition("=")
        if not equals or not key or not value:
            raise UsageError(f"{text}: {item!r} is not parameter=value")
        if key in parameters:
            raise UsageError(f"{text}: parameter {key} is given twice")
        parameters[key] = value
    try:
        share = float(weight)
    except ValueError:
        raise UsageError(f"{text}: weight {weight!r} is not a number; write e.g. @2 or @0.5") from None
    spec = ModelSpec(name=name, parameters=parameters, weight=share)
    _maker(spec)  # raises for what cannot be made
    return spec


def build(spec: ModelSpec, *, fallback: bool = False) -> BatchBehavior:
    """Make the model of a spec; ``fallback``: put the fallback planner around a model that may fail."""
    entry = _entry_for(spec)
    make, guard = _maker(spec)
    if entry.is_own:
        from scex_sumo.base.blame import own_call

        make = own_call(f"{spec.name}: making it", make, error=UsageError)
    driver = make()
    model: BatchBehavior = driver
    if not isinstance(driver, BatchBehavior):
        if not isinstance(driver, SingleVehicleBehavior):
            raise UsageError(
                f"{spec.name}: {type(driver).__name__} has neither plan nor plan_one; needs a class with one "
                "of them, or a function of history"
            )
        from scex_sumo.plug_in.user_model import SingleVehicle

        model = SingleVehicle(driver)
    if fallback and (entry.may_fail or entry.is_own):
        from scex_sumo.plug_in.fallback import Fallible

        model = Fallible(model, str(spec))
    if not guard:
        return model
    from scex_sumo.humans.guard.guarded import Guarded

    return Guarded(model)


def _maker(spec: ModelSpec) -> tuple[Callable[[], Any], bool]:
    """Return the function that makes the model of a spec, and whether the model is guarded."""
    entry = _entry_for(spec)
    if spec.model is not None or not spec.name.startswith(f"{SUMO}:"):
        return maker_of(spec, entry)
    from scex_sumo.base.sumo.car_following import check_driver

    given = {key: str(value) for key, value in spec.parameters.items() if key != "path"}
    model = spec.name.partition(":")[2]
    check_driver(model, given)
    path = parameter_value(spec, "path", entry, spec.parameters.get("path", "straight"))
    return partial(entry.make, model, given, path=path), False
