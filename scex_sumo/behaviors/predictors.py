"""Predictors by decorator: functions from arrays to trajectories, registered as behaviour models."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from scex_sumo.behaviors.plug_in.user_model import predictor_model
from scex_sumo.behaviors.registry import behavior

F = TypeVar("F", bound=Callable[..., Any])


def predictor(name: str | None = None, *, batched: bool = False, **surroundings: Any) -> Callable[[F], F]:
    """Register a function that predicts trajectories as a behaviour model: ``@predictor("my_driver")``.

    Args:
        name: of the model; None registers nothing, for a function that is named by its import path.
        batched: as in `Predictor`.
        surroundings: how much it sees, as in `Surroundings`; parameters of the model.

    Raises:
        UsageError: the name is taken, or the function asks for inputs that there are not.
    """

    def register(function: F) -> F:
        model = predictor_model(function, batched=batched, **surroundings)
        model.make()  # says what is wrong with it where it is written
        function.__scex_predictor__ = model  # type: ignore[attr-defined]
        return function if name is None else behavior(name)(function)

    return register
