"""Registry of behaviour models: parsing what the user asks for, building it, registering further ones."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.learned.models import GraphImagePredictor, GraphPredictor
from scex_sumo.behaviors.models.constant_velocity import ConstantVelocity
from scex_sumo.behaviors.models.emergency_brake import EmergencyBrake
from scex_sumo.behaviors.models.idm import IdmDriver
from scex_sumo.behaviors.models.likely_driver import LikelyDriver
from scex_sumo.behaviors.models.replay import Replay
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.behaviors.plug_in.files import FILES
from scex_sumo.behaviors.plug_in.loading import is_import_path, load_model
from scex_sumo.behaviors.plug_in.process import NAME as PROCESS
from scex_sumo.behaviors.plug_in.process import split_command
from scex_sumo.behaviors.plug_in.single import SingleVehicle, SingleVehicleBehavior
from scex_sumo.behaviors.plug_in.usable import reason_in_model
from scex_sumo.behaviors.plug_in.user_model import UserModel, user_model
from scex_sumo.behaviors.profiles import DEFAULTS, GUARDS
from scex_sumo.behaviors.spec import GUARD, LEARNED, parameter_value, profile_of, shown, user_arguments
from scex_sumo.behaviors.spec import ModelSpec as ModelSpec
from scex_sumo.errors import ScexError, UsageError
from scex_sumo.sumo_models import SUMO_MODELS, check_driver

DEFAULT_MODELS = "standard_driver,risky_driver,constant_velocity,emergency_brake"
ENTRY_POINTS = "scex_sumo.behaviors"
SUMO = "sumo"
# The default has no learned models, though the paper does: what a run gives shall not change with weights.
PAPER_MODELS = ",".join((DEFAULT_MODELS, *LEARNED))
LIKELY_MODELS = "likely_driver:guard=true"  # not what changes with weights, either
SETS: Mapping[str, str] = {"likely": LIKELY_MODELS, "rules": DEFAULT_MODELS, "paper": PAPER_MODELS}

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """What ``scex-sumo models`` prints about a model: parameters are ``name=default``."""

    name: str
    parameters: tuple[str, ...]
    summary: str


_MODELS: Mapping[str, tuple[Callable[[Any], Behavior], str]] = {
    "standard_driver": (IdmDriver, "Intelligent Driver Model, the paper's standard profile"),
    "risky_driver": (IdmDriver, "Intelligent Driver Model, the paper's risky profile: close and fast"),
    "calibrated_driver": (
        IdmDriver,
        "Intelligent Driver Model as people drive, slow in curves, own lane only",
    ),
    "likely_driver": (LikelyDriver, "a driver drawn for every vehicle and child, as people were recorded"),
    "constant_velocity": (ConstantVelocity, "keeps its speed along its path, whatever is in the way"),
    "emergency_brake": (EmergencyBrake, "brakes to a standstill along its path"),
    "graph_predictor": (GraphPredictor, "learned: motion along its path, from the semantic scene graph"),
    "graph_image_predictor": (
        GraphImagePredictor,
        "learned: motion from the scene graph and the road seen from above, weighed by attention",
    ),
    "replay": (Replay, "repeats the recorded future, then constant velocity along its path"),
}
# Models that cannot fail; what they raise is an error of ours. All others may fall back.
RULE_BASED = frozenset(_MODELS) - frozenset(LEARNED)
_registered: dict[str, UserModel] = {}


def behavior(name: str) -> Callable[[T], T]:
    """Register a behaviour model under a name: ``@behavior("my_driver")`` on a class.

    The class has ``plan`` (see `Behavior`) or ``plan_one`` (see `SingleVehicleBehavior`); keyword arguments
    of its constructor are the model's parameters. A function of a vehicle's ``history`` is a `Predictor`.

    Raises:
        UsageError: the name is taken or cannot be written on a command line.
    """

    def register(constructor: T) -> T:
        if name in _MODELS or name == SUMO or name in FILES or name in SETS:
            raise UsageError(f"behavior {name!r}: the name belongs to a built-in model; choose another one")
        if not name or any(c in name for c in ",:@= \t\n"):
            raise UsageError(f"behavior {name!r}: a name has none of , : @ = and no spaces")
        if not callable(constructor):
            raise UsageError(f"behavior {name!r}: register a class or a function that makes a model")
        _registered[name] = user_model(constructor, name)
        return constructor

    return register


def may_fail(spec: ModelSpec) -> bool:
    """Whether a model's plans may be unusable: a user's own model or a learned one."""
    return spec.name not in RULE_BASED and not spec.name.startswith(f"{SUMO}:")


def is_own(spec: ModelSpec) -> bool:
    """Whether a model is the user's: registered, by import path, from a file, or of another package."""
    return spec.name not in _MODELS and not spec.name.startswith(f"{SUMO}:")


def known_names() -> list[str]:
    """Names that `build` can build, ``sumo:<model>`` among them."""
    return [*_MODELS, *(f"{SUMO}:{model}" for model in SUMO_MODELS), *_further()]


def known_models() -> list[ModelInfo]:
    """All models with parameters, defaults and a sentence each."""
    infos = []
    for name, (_, summary) in _MODELS.items():
        parameters = shown({**dataclasses.asdict(DEFAULTS[name]), GUARD: False})
        infos.append(ModelInfo(name=name, parameters=parameters, summary=summary))
    for sumo in SUMO_MODELS:
        summary = f"SUMO's own {sumo}; parameters are SUMO's vehicle type attributes, e.g. tau"
        infos.append(ModelInfo(name=f"{SUMO}:{sumo}", parameters=("path=straight",), summary=summary))
    for name in _further():
        try:
            model = _user_model(name)
        except UsageError as error:  # another package's trouble; the others can be listed
            infos.append(ModelInfo(name=name, parameters=(), summary=str(error).removeprefix(f"{name}: ")))
            continue
        parameters = shown({**model.parameters, GUARD: False})
        infos.append(ModelInfo(name=name, parameters=parameters, summary=model.summary))
    return infos


def parse_models(text: str) -> list[ModelSpec]:
    """Read ``name[:parameter=value]...[@weight]``, several separated by commas.

    A name may be an import path, ``package.module:Class``, or one of `SETS`, which stands for its models.

    Raises:
        UsageError: unknown model or parameter, a weight or value that makes no sense, a model twice.
    """
    given = [part.strip() for part in (text.split(",") if split_command(text) is None else [text])]
    parts = [name for part in given for name in (SETS[part].split(",") if part in SETS else [part])]
    specs = [_parse_one(part) for part in parts if part]
    if not specs:
        raise UsageError(f"no model in {text!r}; known: {', '.join(known_names())}")
    labels = [str(spec) for spec in specs]
    twice = next((label for i, label in enumerate(labels) if label in labels[:i]), None)
    if twice is not None:
        raise UsageError(f"model {twice} is given twice; give it once with a weight, e.g. {twice}@2")
    if not any(spec.weight > 0 for spec in specs):
        raise UsageError(f"all weights in {text!r} are 0; give at least one model a positive weight")
    return specs


def _parse_one(text: str) -> ModelSpec:
    command = split_command(text)
    body, at, weight = text.rpartition("@") if "@" in text and command is None else (text, "", "1")
    name, *rest = body.split(":") if command is None else (PROCESS, *command)
    if name == SUMO:
        if not rest or "=" in rest[0]:
            raise UsageError(f"{text}: name the SUMO model, one of {', '.join(SUMO_MODELS)}, as in sumo:EIDM")
        name = f"{SUMO}:{rest.pop(0)}"
    elif rest and is_import_path(name, rest[0]) and name not in known_names():
        name = f"{name}:{rest.pop(0)}"
    parameters = {}
    for item in rest:
        key, equals, value = item.partition("=")
        if not equals or not key or not value:
            raise UsageError(f"{text}: {item!r} is not parameter=value")
        if key in parameters:
            raise UsageError(f"{text}: parameter {key} is given twice")
        parameters[key] = value
    spec = ModelSpec(name=name, parameters=parameters, weight=_weight(text, weight) if at else 1.0)
    _check(spec)
    return spec


def _weight(text: str, weight: str) -> float:
    try:
        value = float(weight)
    except ValueError:
        raise UsageError(f"{text}: weight {weight!r} is not a number; write e.g. @2 or @0.5") from None
    if not math.isfinite(value) or value < 0:
        raise UsageError(f"{text}: weight {weight} must be a finite number of at least 0")
    return value


def _check(spec: ModelSpec) -> None:
    """Raise a `UsageError` for an unknown name, parameter or value."""
    spec, _ = _without_guard(spec)
    if spec.name.startswith(f"{SUMO}:"):
        check_driver(*_sumo(spec))
    elif spec.name in _MODELS:
        profile_of(spec)
    elif ":" in spec.name or spec.name in _further():
        user_arguments(spec, _user_model(spec.name))
    elif spec.name in SETS:
        raise UsageError(
            f"{spec.name} stands for several models and takes neither parameters nor a weight; "
            f"give them to the models: {SETS[spec.name]}"
        )
    else:
        raise UsageError(f"unknown behavior {spec.name!r}; known: {', '.join(known_names())}")


def build(spec: ModelSpec) -> Behavior:
    """Make the model that a spec asks for.

    Raises:
        UsageError: see `parse_models`.
        MissingExtraError: a learned driver, and PyTorch is not installed.
        InputError: a learned driver whose weights cannot be used.
    """
    _check(spec)
    plain, guard = _without_guard(spec)
    return Guarded(_build(plain), GUARDS.get(plain.name)) if guard else _build(plain)


def _without_guard(spec: ModelSpec) -> tuple[ModelSpec, bool]:
    """The spec of the model itself, and whether it is guarded; SUMO's drivers have no guard."""
    if GUARD not in spec.parameters or spec.name.startswith(f"{SUMO}:"):
        return spec, False
    own = {key: value for key, value in spec.parameters.items() if key != GUARD}
    guard = parameter_value(spec, GUARD, False, spec.parameters[GUARD])
    if not isinstance(guard, bool):
        raise UsageError(f"{spec.name}: {GUARD}={guard!r} is neither true nor false")
    return dataclasses.replace(spec, parameters=own), guard


def _build(spec: ModelSpec) -> Behavior:
    """The model without its guard; the spec has been checked."""
    if spec.name.startswith(f"{SUMO}:"):
        path = parameter_value(spec, "path", "straight", spec.parameters.get("path", "straight"))
        return SumoDriver(*_sumo(spec), path=path)
    if spec.name in _MODELS:
        return _MODELS[spec.name][0](profile_of(spec))
    own = _user_model(spec.name)
    arguments = user_arguments(spec, own)
    try:
        model = own.make(**arguments)
    except ScexError:
        raise
    except Exception as error:  # whatever a user's constructor raises
        raise UsageError(f"{spec.name}: making it {reason_in_model(error)}") from error
    if isinstance(model, Behavior):
        return model
    if isinstance(model, SingleVehicleBehavior):
        return SingleVehicle(model)
    raise UsageError(
        f"{spec.name}: {type(model).__name__} has neither plan nor plan_one; needs a class with one of them, "
        "or a function of history"
    )


def _sumo(spec: ModelSpec) -> tuple[str, dict[str, str]]:
    """SUMO's name of a model, and its parameters as SUMO takes them."""
    given = {key: str(value) for key, value in spec.parameters.items() if key != "path"}
    return spec.name.partition(":")[2], given


def _further() -> list[str]:
    """Models from files, registered ones, and those of other packages."""
    return [*FILES, *sorted({*_registered, *_entry_points()})]


def _entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    return {point.name: point for point in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def _user_model(name: str) -> UserModel:
    known = _registered.get(name) or FILES.get(name)
    if known is not None:
        return known
    if ":" in name:
        return load_model(name)
    point = _entry_points()[name]
    try:
        loaded = point.load()
    except Exception as error:  # anything can go wrong in another package's import
        raise UsageError(f"{name}: entry point {point.value} cannot be loaded: {error}") from error
    return user_model(loaded, name)
