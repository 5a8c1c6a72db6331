"""User models: classes, functions and objects with their parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import import_object, own_error_reason
from scex_sumo.behaviors.plug_in.inputs import Surroundings
from scex_sumo.behaviors.plug_in.predictor import INPUTS, Predictor, name_of, wanted_inputs

EMPTY = inspect.Parameter.empty


@dataclass(frozen=True, kw_only=True)
class UserModel:
    """A user's model that is not made yet."""

    make: Callable[..., Any]  # makes it, with parameters by name
    parameters: Mapping[str, Any]  # their defaults; ``EMPTY`` if there is none
    summary: str  # one sentence for ``scex-sumo models``


def user_model(given: Any, name: str) -> UserModel:
    """Return a class, function or object as a model.

    A function with inputs of a predictor, such as ``history``, predicts; another one makes the model, as does
    a class. An object with ``plan`` or ``plan_one`` is the model.
    """
    if not inspect.isclass(given):
        if hasattr(given, "__scex_predictor__"):
            return given.__scex_predictor__  # type: ignore[no-any-return]
        if hasattr(given, "plan") or hasattr(given, "plan_one"):
            return UserModel(make=lambda: given, parameters={}, summary=_summary(given))
        if is_predictor(given):
            return predictor_model(given)
    if not callable(given):
        kind = type(given).__name__
        raise UsageError(
            f"{name}: is a {kind}; needs a class with plan or plan_one, or a function of history"
        )
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = {key: p.default for key, p in _parameters(given).items() if p.kind in by_name}
    return UserModel(make=given, parameters=parameters, summary=_summary(given))


def predictor_model(function: Callable[..., Any], *, batched: bool = False, **surroundings: Any) -> UserModel:
    """Return a function that predicts as a model.

    Its parameters with a default that are no inputs become parameters, as do the fields of `Surroundings`.

    Args:
        surroundings: fields of `Surroundings` with another default.
    """
    around = asdict(Surroundings(**surroundings))
    defaults = {
        p.name: p.default
        for p in _parameters(function).values()
        if p.name not in INPUTS and p.default is not EMPTY
    }

    def make(**given: Any) -> Predictor:
        options = {name: given.pop(name) for name in defaults if name in given}
        return Predictor(
            partial(function, **options) if options else function,
            inputs=wanted_inputs(function),
            batched=batched,
            surroundings=Surroundings(**(around | given)),
        )

    summary = _summary(function) if function.__doc__ else f"Predictor {name_of(function)}"
    return UserModel(make=make, parameters=defaults | around, summary=summary)


def is_predictor(given: Any) -> bool:
    """Return whether an object is a function of a vehicle's inputs."""
    parameters = {} if inspect.isclass(given) or not callable(given) else _parameters(given)
    return any(p.name in INPUTS and p.default is EMPTY for p in parameters.values())


def _parameters(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(function).parameters
    except (TypeError, ValueError):
        return {}


def _summary(given: Any) -> str:
    words = (inspect.getdoc(given) or "").strip().splitlines()
    return words[0] if words else "registered"


def is_import_path(module: str, attribute: str) -> bool:
    """Return whether both parts of ``module:attribute`` consist of identifiers."""
    return all(part.isidentifier() for part in module.split(".")) and attribute.isidentifier()


def load_model(path: str) -> UserModel:
    """Import the model of an import path ``package.module:Class``."""
    hint = "; a model is name[:parameter=value]... or package.module:Class"
    return user_model(import_object(path, hint=hint, reason=own_error_reason), path)
