"""Registry of behaviour models: names, defaults, parsing, building, users' models."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from scex_sumo.base.errors import ScexError, UsageError, nearest
from scex_sumo.base.importing import Registry, own_error_reason
from scex_sumo.base.programs import SUMO_MODELS, check_driver
from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmDriver, IdmProfile
from scex_sumo.behaviors.models.simple import (
    ConstantVelocity,
    ConstantVelocityProfile,
    EmergencyBrake,
    EmergencyBrakeProfile,
    Replay,
    ReplayProfile,
)
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.behaviors.spec import (
    GUARD,
    LEARNED,
    parameter_texts,
    parameter_value,
    profile_of,
    user_arguments,
)
from scex_sumo.behaviors.spec import ModelSpec as ModelSpec
from scex_sumo.humans.driver import LikelyDriver, LikelyProfile
from scex_sumo.humans.guard.corridors import GuardProfile
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.learned.models import GraphImagePredictor, GraphPredictor, JointPredictor
from scex_sumo.learned.profiles import (
    GraphImagePredictorProfile,
    GraphPredictorProfile,
    JointPredictorProfile,
)
from scex_sumo.plug_in.files import FILES, PROCESS_NAME, split_command
from scex_sumo.plug_in.user_model import (
    SingleVehicle,
    SingleVehicleBehavior,
    UserModel,
    is_import_path,
    load_model,
    predictor_model,
    user_model,
)

DEFAULT_MODELS = "standard_driver,risky_driver,constant_velocity,emergency_brake"
SUMO = "sumo"
# Without learned models, so that new weights do not change default results.
PAPER_MODELS = f"{DEFAULT_MODELS},graph_predictor,graph_image_predictor"
LIKELY_MODELS = "likely_driver"
SETS: Mapping[str, str] = {"likely": LIKELY_MODELS, "rules": DEFAULT_MODELS, "paper": PAPER_MODELS}

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """A model as ``scex-sumo models`` prints it; parameters are ``name=default``."""

    name: str
    parameters: tuple[str, ...]
    summary: str


# Class, default profile and summary of each built-in model. Parameters of the standard and the risky
# driver: Zipfl, Schütt, Zöllner 2024, except max_acceleration, which the paper does not state.
_MODELS: Mapping[str, tuple[Callable[[Any], Behavior], Any, str]] = {
    "standard_driver": (
        IdmDriver,
        IdmProfile(
            comfort_deceleration=3.0, time_headway=3.1, minimum_gap=9.0, max_acceleration=1.5, clearance=5.0
        ),
        "Intelligent Driver Model, the paper's standard profile",
    ),
    "risky_driver": (
        IdmDriver,
        IdmProfile(
            comfort_deceleration=8.0, time_headway=2.1, minimum_gap=5.0, max_acceleration=3.0, clearance=5.0
        ),
        "Intelligent Driver Model, the paper's risky profile: close and fast",
    ),
    "calibrated_driver": (
        IdmDriver,
        CALIBRATED,
        "Intelligent Driver Model as people drive, slow in curves, own lane only",
    ),
    "likely_driver": (
        LikelyDriver,
        LikelyProfile(),
        "a driver drawn for every vehicle and future, as people were recorded",
    ),
    "constant_velocity": (
        ConstantVelocity,
        ConstantVelocityProfile(),
        "keeps its speed along its path, whatever is in the way",
    ),
    "emergency_brake": (
        EmergencyBrake,
        EmergencyBrakeProfile(deceleration=5.0),
        "brakes to a standstill along its path",
    ),
    "graph_predictor": (
        GraphPredictor,
        GraphPredictorProfile(),
        "learned: motion along its path, from the semantic scene graph",
    ),
    "graph_image_predictor": (
        GraphImagePredictor,
        GraphImagePredictorProfile(),
        "learned: motion from the scene graph and the road seen from above, weighed by attention",
    ),
    "joint_predictor": (
        JointPredictor,
        JointPredictorProfile(),
        "learned: the motion of all vehicles drawn together, every 0.5 s",
    ),
    "replay": (Replay, ReplayProfile(), "repeats the recorded future, then constant velocity along its path"),
}
DEFAULTS: Mapping[str, Any] = {name: defaults for name, (_, defaults, _) in _MODELS.items()}
"""Default profile of each built-in model."""

# Guards other than the default: people drive closer together than the default guard allows.
_GUARDS: Mapping[str, GuardProfile] = {
    "likely_driver": GuardProfile(
        comfort_deceleration=6.5,
        reaction_time=0.2,
        minimum_gap=0.3,
        margin=0.15,
        alongside_margin=0.05,
        time_margin=0.3,
        touching=0.3,
    )
}
# An exception of these models is a bug of this package; all other models may fall back.
RULE_BASED = frozenset(_MODELS) - frozenset(LEARNED)
EXTENSIONS = Registry(group="scex_sumo.behaviors", kind="behavior")
_BUILT_IN = {*_MODELS, SUMO, *FILES, *SETS}
_registered: dict[str, UserModel] = {}


def behavior(name: str) -> Callable[[T], T]:
    """Register a behaviour model: ``@behavior("my_driver")`` on a class with ``plan`` or ``plan_one``.

    See `Behavior` and `SingleVehicleBehavior`. Keyword arguments of the constructor are the parameters. A
    function of a vehicle's ``history`` becomes a `Predictor`.

    Raises:
        UsageError: the name is taken or cannot be written on a command line.

    Example:
        >>> @scex.behavior("parked")
        ... class Parked:
        ...     def plan(self, history, road, who, rng):
        ...         now = history.now[who.child, who.vehicle]
        ...         x, y, heading = (np.repeat(a[:, None], 30, axis=1) for a in (now.x, now.y, now.heading))
        ...         return scex.Plan(x=x, y=y, heading=heading, speed=np.zeros_like(x))
        >>> [str(model) for model in scex.parse_models("parked")]
        ['parked']
    """

    def register(constructor: T) -> T:
        if name in _BUILT_IN:
            raise UsageError(f"behavior {name!r}: the name belongs to a built-in model; choose another one")
        if not name or any(c in name for c in ",:@= \t\n"):
            raise UsageError(f"behavior {name!r}: a name must not contain , : @ = or spaces")
        if not callable(constructor):
            raise UsageError(f"behavior {name!r}: register a class or a function that makes a model")
        _registered[name] = user_model(constructor, name)
        return constructor

    return register


def predictor(name: str | None = None, *, batched: bool = False, **surroundings: Any) -> Callable[[F], F]:
    """Register a function that predicts trajectories: ``@predictor("my_driver")``.

    Args:
        name: None gives it no name except its import path.
        batched: as in `Predictor`.
        surroundings: fields of `Surroundings`; they become parameters of the model.

    Raises:
        UsageError: the name is taken, or the function asks for unknown inputs.

    Example:
        >>> @scex.predictor("straight")
        ... def straight(history):
        ...     way = 0.1 * history[:, -1, 4:] * np.arange(1, 31)
        ...     return np.stack([way, np.zeros_like(way)], axis=-1)
        >>> [str(model) for model in scex.parse_models("straight:radius=30")]
        ['straight:radius=30']
    """

    def register(function: F) -> F:
        model = predictor_model(function, batched=batched, **surroundings)
        model.make()  # raises where the function is written, not where it is used
        function.__scex_predictor__ = model  # type: ignore[attr-defined]
        return function if name is None else behavior(name)(function)

    return register


def may_fail(spec: ModelSpec) -> bool:
    """Return whether a model is learned or a user's, so that plans may be unusable."""
    return spec.name not in RULE_BASED and not _is_sumo(spec)


def is_own(spec: ModelSpec) -> bool:
    """Return whether a model is the user's."""
    return spec.name not in _MODELS and not _is_sumo(spec)


def _is_sumo(spec: ModelSpec) -> bool:
    return spec.name.startswith(f"{SUMO}:")


def known_names() -> list[str]:
    """Return the names that `build` accepts, ``sumo:<model>`` among them."""
    return [*_MODELS, *(f"{SUMO}:{model}" for model in SUMO_MODELS), *_user_names()]


def known_models() -> list[ModelInfo]:
    """Return all models."""
    infos = []
    for name, (_, defaults, summary) in _MODELS.items():
        parameters = parameter_texts({**dataclasses.asdict(defaults), GUARD: False})
        infos.append(ModelInfo(name=name, parameters=parameters, summary=summary))
    for sumo in SUMO_MODELS:
        summary = f"SUMO's own {sumo}; parameters are SUMO's vehicle type attributes, e.g. tau"
        infos.append(ModelInfo(name=f"{SUMO}:{sumo}", parameters=("path=straight",), summary=summary))
    for name in _user_names():
        try:
            model = _user_model(name)
        except UsageError as error:  # a broken package does not hide the other models
            infos.append(ModelInfo(name=name, parameters=(), summary=str(error).removeprefix(f"{name}: ")))
            continue
        parameters = parameter_texts({**model.parameters, GUARD: False})
        infos.append(ModelInfo(name=name, parameters=parameters, summary=model.summary))
    return infos


def parse_models(text: str) -> list[ModelSpec]:
    """Read ``name[:parameter=value]...[@weight]``, several separated by commas.

    A name may be an import path, ``package.module:Class``, or a set: ``likely``, ``rules``, ``paper``.

    Raises:
        UsageError: a model or parameter is unknown, a weight or value is invalid, or a model is given twice.

    Example:
        >>> [str(spec) for spec in scex.parse_models("standard_driver@2,risky_driver:minimum_gap=3")]
        ['standard_driver', 'risky_driver:minimum_gap=3']
    """
    if not isinstance(text, str):
        raise UsageError(f"got {text!r} as a model; give its name, e.g. standard_driver")
    given = [part.strip() for part in (text.split(",") if split_command(text) is None else [text])]
    parts = [name for part in given for name in (SETS[part].split(",") if part in SETS else [part])]
    specs = [_parse_one(part) for part in parts if part]
    if not specs:
        raise UsageError(f"no model in {text!r}; give e.g. standard_driver; 'scex-sumo models' lists all")
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
    name, *rest = body.split(":") if command is None else (PROCESS_NAME, *command)
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
        return float(weight)
    except ValueError:
        raise UsageError(f"{text}: weight {weight!r} is not a number; write e.g. @2 or @0.5") from None


def _check(spec: ModelSpec) -> None:
    spec, _ = _without_guard(spec)
    if _is_sumo(spec):
        check_driver(*_sumo_arguments(spec))
    elif spec.name in _MODELS:
        profile_of(spec, DEFAULTS[spec.name])
    elif ":" in spec.name or spec.name in _user_names():
        user_arguments(spec, _user_model(spec.name))
    elif spec.name in SETS:
        raise UsageError(
            f"{spec.name} stands for several models and takes neither parameters nor a weight; "
            f"give them to the models: {SETS[spec.name]}"
        )
    else:
        names = nearest(spec.name, [*known_names(), *SETS])
        raise UsageError(f"unknown behavior {spec.name!r}; nearest: {names}; 'scex-sumo models' lists all")


def build(spec: ModelSpec) -> Behavior:
    """Make the model of a spec."""
    _check(spec)
    plain, guard = _without_guard(spec)
    return Guarded(_build(plain), _GUARDS.get(plain.name)) if guard else _build(plain)


def _without_guard(spec: ModelSpec) -> tuple[ModelSpec, bool]:
    if GUARD not in spec.parameters or _is_sumo(spec):
        return spec, False
    others = {key: value for key, value in spec.parameters.items() if key != GUARD}
    guard = parameter_value(spec, GUARD, False, spec.parameters[GUARD])
    if not isinstance(guard, bool):
        raise UsageError(f"{spec.name}: {GUARD}={guard!r} is neither true nor false")
    return dataclasses.replace(spec, parameters=others), guard


def _build(spec: ModelSpec) -> Behavior:
    if _is_sumo(spec):
        path = parameter_value(spec, "path", "straight", spec.parameters.get("path", "straight"))
        return SumoDriver(*_sumo_arguments(spec), path=path)
    if spec.name in _MODELS:
        return _MODELS[spec.name][0](profile_of(spec, DEFAULTS[spec.name]))
    user = _user_model(spec.name)
    arguments = user_arguments(spec, user)
    try:
        model = user.make(**arguments)
    except ScexError:
        raise
    except Exception as error:  # whatever a user's constructor raises
        raise UsageError(f"{spec.name}: making it {own_error_reason(error)}") from error
    if isinstance(model, Behavior):
        return model
    if isinstance(model, SingleVehicleBehavior):
        return SingleVehicle(model)
    raise UsageError(
        f"{spec.name}: {type(model).__name__} has neither plan nor plan_one; needs a class with one of them, "
        "or a function of history"
    )


def _sumo_arguments(spec: ModelSpec) -> tuple[str, dict[str, str]]:
    given = {key: str(value) for key, value in spec.parameters.items() if key != "path"}
    return spec.name.partition(":")[2], given


def _user_names() -> list[str]:
    return [*FILES, *sorted({*_registered, *EXTENSIONS.paths} - _BUILT_IN)]


def _user_model(name: str) -> UserModel:
    model = _registered.get(name) or FILES.get(name)
    if model is not None:
        return model
    if ":" in name:
        return load_model(name)
    try:
        return user_model(EXTENSIONS.load(name), name)
    except UsageError as error:
        raise UsageError(f"{name}: {str(error).removeprefix(f'{name}: ')}") from error
