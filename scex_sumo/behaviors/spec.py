"""Registry entry of a behaviour model, and a user's specification of one: parameters and their checks."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.behaviors.base import MAX_PARAMETER, MIN_PARAMETER

EMPTY: Final = inspect.Parameter.empty
GUARD: Final = "guard"  # a parameter of every model but SUMO's


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """Entry of the model registry: how a model is made, and what it says of itself."""

    make: Callable[..., Any]  # from the profile, else from parameters by name
    summary: str  # one sentence for ``scex-sumo models``
    profile: Any = None  # the default parameters, a frozen dataclass
    parameters: Mapping[str, Any] = field(default_factory=dict)  # without one: defaults, `EMPTY` if none
    path_words: tuple[str, ...] = ()  # of ``path`` beside an index, ``straight`` and ``random``
    takes_guard: bool = True  # whether it has the parameter ``guard``
    may_fail: bool = True  # whether plans may be unusable, so that a fallback planner stands by
    is_own: bool = True  # whether it is the user's; a vehicle that it is assigned to is under test
    moves: tuple[str, ...] = ()  # road users that it moves, e.g. ``pedestrian``; (): vehicles
    split: Callable[[str], list[str]] | None = None  # of the text after the name; None: at each colon
    place: int = 1000  # in the list of models

    @property
    def defaults(self) -> dict[str, Any]:
        """Default of each parameter; ``EMPTY`` if there is none."""
        own = self.parameters if self.profile is None else vars(self.profile)
        return {**own, GUARD: False} if self.takes_guard else dict(own)


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """A requested behaviour model.

    Attributes:
        name: e.g. ``standard_driver``, ``sumo:EIDM``, ``package.module:Driver``; of an object, any name.
        parameters: values other than the defaults; text if they come from the command line.
        weight: relative share of the vehicles.
        model: a user's class, function or object; None for a model that is found by its name.
        state: SHA-256 of the object; results of another one are other results.

    Example:
        >>> scex.ModelSpec(name="risky_driver", parameters={"time_headway": 0.7}, weight=2).weight
        2
    """

    name: str
    parameters: dict[str, Any] = field(default_factory=dict, hash=False)
    weight: float = 1.0
    model: Any = field(default=None, compare=False, repr=False)
    state: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        if self.model is not None and not self.state:
            from scex_sumo.behaviors.objects import state_of

            object.__setattr__(self, "state", state_of(self.model))
        if not (self.weight == 0 or MIN_PARAMETER <= self.weight <= MAX_PARAMETER):
            wanted = f"0 or a number from {MIN_PARAMETER:g} to {MAX_PARAMETER:g}"
            raise UsageError(f"{self}: weight {self.weight:g}; give {wanted}")

    def __str__(self) -> str:
        """Name and parameters as on the command line, without the weight."""
        return ":".join([self.name, *(f"{key}={value}" for key, value in self.parameters.items())])


def maker_of(spec: ModelSpec, entry: ModelEntry) -> tuple[Callable[[], Any], bool]:
    """Return the function that makes the model of a spec, and whether the model is guarded.

    `UsageError`: a parameter is unknown, missing, or has a wrong value.
    """
    defaults = entry.defaults
    for key in spec.parameters:
        if key not in defaults:
            known = f"nearest: {nearest(key, defaults)}" if defaults else "it has none"
            raise UsageError(f"{spec.name}: unknown parameter {key!r}; {known}")
    values = {key: parameter_value(spec, key, entry, value) for key, value in spec.parameters.items()}
    guard = values.pop(GUARD, False)
    if not isinstance(guard, bool):
        raise UsageError(f"{spec.name}: {GUARD}={guard!r} is neither true nor false")
    if entry.profile is not None:
        try:
            return partial(entry.make, dataclasses.replace(entry.profile, **values)), guard
        except UsageError as error:
            raise UsageError(f"{spec.name}: {error}") from None
    missing = [key for key, default in defaults.items() if default is EMPTY and key not in values]
    if missing:
        given = f"{missing[0]}=value" if spec.model is None else "an argument of an object"
        is_function = inspect.isfunction(entry.make)
        hint = "; a function that predicts names its inputs, e.g. history" if is_function else ""
        raise UsageError(f"{spec.name}: parameter {missing[0]} has no default; give it as {given}{hint}")
    return partial(entry.make, **values), guard


def parameter_value(spec: ModelSpec, key: str, entry: ModelEntry, value: Any) -> Any:
    """Convert text to the type of the default; return other values unchanged."""
    if not isinstance(value, str):
        return value
    default, words = entry.defaults[key], ("straight", "random", *entry.path_words)
    if key == "path" and (default in words or isinstance(default, int)):  # else it is a user's file
        wanted = f"an index, {', '.join(words[:-1])} or {words[-1]}"
        return value if value in words else _number(spec, key, value, int, wanted)
    if isinstance(default, bool):
        if value.lower() not in ("true", "false", "0", "1"):
            raise UsageError(f"{spec.name}: {key}={value} is neither true nor false")
        return value.lower() in ("true", "1")
    if isinstance(default, int | float):
        what = "a whole number" if isinstance(default, int) else "a number"
        return _number(spec, key, value, type(default), what)
    return value


def _number(spec: ModelSpec, key: str, value: str, kind: Callable[[str], Any], wanted: str) -> Any:
    try:
        return kind(value)
    except ValueError:
        raise UsageError(f"{spec.name}: {key}={value} is not {wanted}") from None
