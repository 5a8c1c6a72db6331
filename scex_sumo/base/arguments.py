"""The types of arguments of public functions; a wrong one is one line."""

from __future__ import annotations

import ast
import functools
import inspect
import os
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np

from scex_sumo.base.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])

_KINDS: dict[str, Any] = {
    "int": Integral,
    "float": Real,
    "str": str,
    "None": type(None),
    "Path": os.PathLike,
    "Mapping": Mapping,
    "Callable": Callable,
    "bool": (bool, np.bool_),
}
_ALIASES = {
    "Progress": "Callable",
    "Place": "tuple[float, float]",
    "Window": "tuple[float | None, float | None]",
    "Weights": "Mapping",
}
_CLASSES = {
    *("LoadedRecording", "Recording", "Region", "Road", "Run", "RunSettings"),
    *("SceneGraph", "SceneHistory", "SeedScene", "Suite"),
}


def fits(value: Any, wanted: str) -> bool:
    """Tell whether a value may be of a type, written as an annotation such as ``str | Path``.

    Our classes are found by their name among those of the value; items of ``Sequence`` and ``tuple`` are
    checked, too. Every value fits a type of another name.
    """
    return _fits(value, _parsed(wanted))


@functools.cache
def _parsed(annotation: str) -> ast.expr:
    return ast.parse(annotation, mode="eval").body


def _fits(value: Any, wanted: ast.expr) -> bool:
    if isinstance(wanted, ast.BinOp):
        return _fits(value, wanted.left) or _fits(value, wanted.right)
    outer = wanted.value if isinstance(wanted, ast.Subscript) else wanted
    name = ast.unparse(outer)
    if name in _ALIASES:
        return fits(value, _ALIASES[name])
    if name in _KINDS:
        return isinstance(value, _KINDS[name]) and not (isinstance(value, bool) and name in ("int", "float"))
    if name not in ("Sequence", "tuple"):
        return name not in _CLASSES or any(kind.__name__ == name for kind in type(value).__mro__)
    if isinstance(value, (str, bytes, Mapping)) or not hasattr(value, "__len__"):
        return False
    assert isinstance(wanted, ast.Subscript)
    items = wanted.slice.elts if isinstance(wanted.slice, ast.Tuple) else [wanted.slice]
    if name == "Sequence" or ast.unparse(items[-1]) == "...":
        return all(_fits(item, items[0]) for item in value)
    return len(value) == len(items) and all(map(_fits, value, items))


def check_argument(name: str, value: Any, wanted: str) -> None:
    """Raise a `UsageError` for a value that is not of the wanted type."""
    if not fits(value, wanted):
        raise UsageError(f"{name}: got {value!r:.60}, needs {wanted}")


def checked(function: F) -> F:
    """Check the arguments of a public function by its annotations before it is called."""
    signature = inspect.signature(function)
    wanted = {
        parameter.name: str(parameter.annotation)
        for parameter in signature.parameters.values()
        if parameter.annotation is not parameter.empty
        and parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
    }

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        given = signature.bind(*args, **kwargs).arguments
        for name in wanted.keys() & given.keys():
            check_argument(name, given[name], wanted[name])
        return function(*args, **kwargs)

    return call  # type: ignore[return-value]
