"""Model specification: a model as asked for, and the values of its parameters as the model needs them."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from scex_sumo.behaviors.plug_in.user_model import EMPTY, UserModel
from scex_sumo.behaviors.profiles import DEFAULTS
from scex_sumo.errors import UsageError

GUARD = "guard"  # a parameter of every model that we drive
LEARNED = ("graph_predictor", "graph_image_predictor")


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """A behaviour model as asked for.

    Attributes:
        name: e.g. ``standard_driver``, ``sumo:EIDM`` or ``package.module:Driver``.
        parameters: values that differ from the defaults; text where they come from the command line.
        weight: how often it is drawn, relative to the others.
    """

    name: str
    parameters: dict[str, Any] = field(default_factory=dict)
    weight: float = 1.0

    def __str__(self) -> str:
        """Name and parameters as on the command line, without the weight."""
        return ":".join([self.name, *(f"{key}={value}" for key, value in self.parameters.items())])


def profile_of(spec: ModelSpec) -> Any:
    """Parameters of a built-in model: its defaults with the given values."""
    defaults = DEFAULTS[spec.name]
    known = vars(defaults)
    known_parameter(spec, tuple(known))
    values = {key: parameter_value(spec, key, known[key], value) for key, value in spec.parameters.items()}
    try:
        return dataclasses.replace(defaults, **values)
    except UsageError as error:
        raise UsageError(f"{spec.name}: {error}") from None


def known_parameter(spec: ModelSpec, known: tuple[str, ...]) -> None:
    """Raise a `UsageError` where a spec has another parameter than the known ones."""
    for key in spec.parameters:
        if key not in known:
            raise UsageError(f"{spec.name}: unknown parameter {key!r}; known: {', '.join((*known, GUARD))}")


def parameter_value(spec: ModelSpec, key: str, default: Any, value: Any) -> Any:
    """A value from the command line as the type of its default; other values stay as they are."""
    if not isinstance(value, str):
        return value
    words = ["straight", "random", *(["likeliest"] if spec.name in LEARNED else [])]
    words += ["fitted"] if spec.name == "likely_driver" else []
    if key == "path" and (default in words or isinstance(default, int)):  # not a file of a user's model
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


def user_arguments(spec: ModelSpec, model: UserModel) -> dict[str, Any]:
    """What a model of the user's own is made with.

    Raises:
        UsageError: a parameter that it does not have, or one without a value.
    """
    known = model.parameters
    known_parameter(spec, tuple(known))
    missing = [key for key, default in known.items() if default is EMPTY and key not in spec.parameters]
    if missing:
        own = inspect.isfunction(model.make)
        hint = "; a function that predicts names its inputs, e.g. history" if own else ""
        raise UsageError(
            f"{spec.name}: parameter {missing[0]} has no default; give it as {missing[0]}=value{hint}"
        )
    return {key: parameter_value(spec, key, known[key], value) for key, value in spec.parameters.items()}


def shown(parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Parameters as ``name=default``, or the name alone where there is none."""
    words = {True: "true", False: "false"}  # as on the command line
    written = {k: words[v] if isinstance(v, bool) else v for k, v in parameters.items()}
    return tuple(key if value is EMPTY else f"{key}={value}" for key, value in written.items())
