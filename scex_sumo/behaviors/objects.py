"""Classes, functions and objects that drive: their names, parameters and digests."""

from __future__ import annotations

import hashlib
import inspect
import pickle
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any


def label_of(model: Any) -> str:
    """Return a readable name of a class, function or object, with parameters other than the defaults.

    An object shows the parameters of its constructor that it keeps as attributes: numbers, texts, booleans.
    """
    values: dict[str, Any] = {}
    if isinstance(model, partial):
        name, values = label_of(model.func), model.keywords
    elif hasattr(model, "__name__"):
        name = str(model.__name__)
    else:
        name, defaults = type(model).__name__, signature_of(type(model))
        values = {key: getattr(model, key, p.default) for key, p in defaults.items()}
        values = {key: value for key, value in values.items() if str(value) != str(defaults[key].default)}
    shown = {key: value for key, value in values.items() if isinstance(value, bool | int | float | str)}
    return ":".join([name, *parameter_texts(shown)])


def state_of(model: Any) -> str:
    """Return the SHA-256 of an object; by value if its class is not in a file."""
    with suppress(Exception):  # of the object's own code
        packed = pickle.dumps(model)
        if b"__main__" not in packed or hasattr(sys.modules["__main__"], "__file__"):
            return hashlib.sha256(packed).hexdigest()
    with suppress(Exception):
        import cloudpickle

        return hashlib.sha256(cloudpickle.dumps(model)).hexdigest()
    import secrets

    return secrets.token_hex(32)  # it cannot be compared, so that no result of it is resumed


def signature_of(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a function or class; none if Python does not know them."""
    try:
        return inspect.signature(function).parameters
    except (TypeError, ValueError):
        return {}


def parameter_texts(parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Format parameters as ``name=default``; without a default, the name alone."""
    words = {True: "true", False: "false"}  # as on the command line
    written = {k: words[v] if isinstance(v, bool) else v for k, v in parameters.items()}
    return tuple(
        key if value is inspect.Parameter.empty else f"{key}={value}" for key, value in written.items()
    )
