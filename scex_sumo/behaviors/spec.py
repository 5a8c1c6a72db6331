"""Model specification: a model's name, parameters and weight, and their checks."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.behaviors.base import MAX_PARAMETER, MIN_PARAMETER
from scex_sumo.plug_in.user_model import EMPTY, UserModel

GUARD = "guard"  # a parameter of every model but SUMO's
LEARNED = ("graph_predictor", "graph_image_predictor", "joint_predictor")


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """A requested behaviour model.

    Attributes:
        parameters: values other than the defaults; text if they come from the command line.
    """

    name: str  # e.g. ``standard_driver``, ``sumo:EIDM`` or ``package.module:Driver``.
    parameters: dict[str, Any] = field(default_factory=dict)
    weight: float = 1.0  # relative share of the vehicles

    def __post_init__(self) -> None:
        if not (self.weight == 0 or MIN_PARAMETER <= self.weight <= MAX_PARAMETER):
            wanted = f"0 or a number from {MIN_PARAMETER:g} to {MAX_PARAMETER:g}"
            raise UsageError(f"{self}: weight {self.weight:g}; give {wanted}")

    def __str__(self) -> str:
        """Name and parameters as on the command line, without the weight."""
        return ":".join([self.name, *(f"{key}={value}" for key, value in self.parameters.items())])


def profile_of(spec: ModelSpec, defaults: Any) -> Any:
    """Return a built-in model's profile with the given values."""
    values = _typed_parameters(spec, vars(defaults))
    try:
        return dataclasses.replace(defaults, **values)
    except UsageError as error:
        raise UsageError(f"{spec.name}: {error}") from None


def user_arguments(spec: ModelSpec, model: UserModel) -> dict[str, Any]:
    """Return the arguments that make a user's model."""
    values = _typed_parameters(spec, model.parameters)
    missing = [key for key, default in model.parameters.items() if default is EMPTY and key not in values]
    if missing:
        is_function = inspect.isfunction(model.make)
        hint = "; a function that predicts names its inputs, e.g. history" if is_function else ""
        raise UsageError(
            f"{spec.name}: parameter {missing[0]} has no default; give it as {missing[0]}=value{hint}"
        )
    return values


def _typed_parameters(spec: ModelSpec, defaults: Mapping[str, Any]) -> dict[str, Any]:
    for key in spec.parameters:
        if key not in defaults:
            known = nearest(key, [*defaults, GUARD])
            raise UsageError(f"{spec.name}: unknown parameter {key!r}; nearest: {known}")
    return {key: parameter_value(spec, key, defaults[key], value) for key, value in spec.parameters.items()}


def parameter_value(spec: ModelSpec, key: str, default: Any, value: Any) -> Any:
    """Convert text to the type of the default; return other values unchanged."""
    if not isinstance(value, str):
        return value
    words = ["straight", "random", *(["likeliest"] if spec.name in LEARNED else [])]
    words += ["fitted"] if spec.name == "likely_driver" else []
    if key == "path" and (default in words or isinstance(default, int)):  # else it is a user's file
        wanted = f"an index, {', '.join(words[:-1])} or {words[-1]}"
        return value if value in words else _number(spec, key, value, int, wanted)
    if isinstance(default, bool):
        if value.lower() not in ("true", "false", "0", "1"):
            raise UsageError(f"{spec.name}: {key}={value} is neither true nor false")
        return value.lower() in ("true", "1")
    if isinstance(default, int):
        return _number(spec, key, value, int, "a whole number")
    if isinstance(default, float):
        return _number(spec, key, value, float, "a number")
    return value


def _number(spec: ModelSpec, key: str, value: str, kind: Callable[[str], Any], wanted: str) -> Any:
    try:
        return kind(value)
    except ValueError:
        raise UsageError(f"{spec.name}: {key}={value} is not {wanted}") from None


def parameter_texts(parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Format parameters as ``name=default``; without a default, the name alone."""
    words = {True: "true", False: "false"}  # as on the command line
    written = {k: words[v] if isinstance(v, bool) else v for k, v in parameters.items()}
    return tuple(key if value is EMPTY else f"{key}={value}" for key, value in written.items())
