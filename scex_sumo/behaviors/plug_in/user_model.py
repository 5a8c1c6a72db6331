"""Models of the user's own, not made yet: classes, functions and objects, with their parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

from scex_sumo.behaviors.plug_in.inputs import Surroundings
from scex_sumo.behaviors.plug_in.predictor import INPUTS, Predictor, name_of, wanted_inputs
from scex_sumo.errors import UsageError

EMPTY = inspect.Parameter.empty
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class UserModel:
    """A model of the user's own.

    Attributes:
        make: makes it, with parameters by name.
        parameters: their defaults; ``EMPTY`` where one must be given.
        summary: a sentence, as ``scex-sumo models`` prints it.
    """

    make: Callable[..., Any]
    parameters: Mapping[str, Any]
    summary: str


def user_model(found: Any, name: str) -> UserModel:
    """What a name stands for, as a model.

    A class and a function that returns a model make it. A function whose parameters are inputs of a
    predictor, such as ``history``, predicts. An object with ``plan`` or ``plan_one`` is a model.

    Raises:
        UsageError: it is none of these.
    """
    if not inspect.isclass(found):
        if hasattr(found, "__scex_predictor__"):
            return found.__scex_predictor__  # type: ignore[no-any-return]
        if hasattr(found, "plan") or hasattr(found, "plan_one"):
            return UserModel(make=lambda: found, parameters={}, summary=_summary(found))
        if is_predictor(found):
            return predictor_model(found)
    if not callable(found):
        kind = type(found).__name__
        raise UsageError(
            f"{name}: is a {kind}; needs a class with plan or plan_one, or a function of history"
        )
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    known = {key: p.default for key, p in _parameters(found).items() if p.kind in by_name}
    return UserModel(make=found, parameters=known, summary=_summary(found))


def predictor_model(function: Callable[..., Any], *, batched: bool = False, **surroundings: Any) -> UserModel:
    """A function that predicts, as a model.

    Its parameters are those of the function that have a default and are no inputs, and how much it sees.

    Args:
        batched: as in `Predictor`.
        surroundings: how much it sees, as in `Surroundings`.
    """
    around = asdict(Surroundings(**surroundings))
    parameters = _parameters(function).values()
    own = {p.name: p.default for p in parameters if p.name not in INPUTS and p.default is not EMPTY}

    def make(**given: Any) -> Predictor:
        mine = {name: given.pop(name) for name in own if name in given}
        return Predictor(
            partial(function, **mine) if mine else function,
            inputs=wanted_inputs(function),
            batched=batched,
            surroundings=Surroundings(**(around | given)),
        )

    summary = _summary(function) if function.__doc__ else f"Predictor {name_of(function)}"
    return UserModel(make=make, parameters=own | around, summary=summary)


def is_predictor(found: Any) -> bool:
    """Whether something is a function of a vehicle's history, and not a class or one that makes a model."""
    parameters = {} if inspect.isclass(found) or not callable(found) else _parameters(found)
    return any(p.name in INPUTS and p.default is EMPTY for p in parameters.values())


def _parameters(found: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(found).parameters
    except (TypeError, ValueError):
        return {}


def _summary(found: Any) -> str:
    words = (inspect.getdoc(found) or "").strip().splitlines()
    return words[0] if words else "registered"
