"""Frozen dataclasses whose methods are shared by all of them.

The standard library writes and compiles those of every class anew, half as long as NumPy takes to load.
"""

from __future__ import annotations

import dataclasses
import inspect
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(*, frozen=False, kw_only=False, eq=True, slots=False):
        """What ``dataclasses.dataclass`` makes, sooner where all fields are frozen and given by name."""
        if slots or not (frozen and kw_only):
            return dataclasses.dataclass(frozen=frozen, kw_only=kw_only, eq=eq, slots=slots)

        def made(cls):
            cls = dataclasses.dataclass(init=False, repr=False, eq=False, kw_only=True)(cls)
            cls.__record__, cls.__signature__ = dataclasses.fields(cls), _Signature()
            shared = {"__init__": _init, "__repr__": _repr, "__setattr__": _refuse, "__delattr__": _refuse}
            for name, method in (shared | ({"__eq__": _equal, "__hash__": _hash} if eq else {})).items():
                if name not in vars(cls):
                    setattr(cls, name, method)
            return cls

        return made


class _Signature:
    """What ``inspect.signature`` says of a class."""

    def __get__(self, _: Any, cls: Any) -> inspect.Signature:
        kind = inspect.Parameter.KEYWORD_ONLY
        defaults = {field.name: _default(field) for field in cls.__record__}
        return inspect.Signature(
            [inspect.Parameter(name, kind, default=default) for name, default in defaults.items()]
        )


def _default(field: dataclasses.Field[Any]) -> Any:
    given = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
    return field.default if given else inspect.Parameter.empty


def _init(self: Any, /, **given: Any) -> None:
    """Set all fields."""
    values = vars(self)
    for field in self.__record__:
        if field.name in given:
            values[field.name] = given.pop(field.name)
        elif field.default is not dataclasses.MISSING:
            values[field.name] = field.default
        elif field.default_factory is not dataclasses.MISSING:
            values[field.name] = field.default_factory()
        else:
            raise TypeError(f"{type(self).__name__}() needs {field.name}")
    if given:
        raise TypeError(f"{type(self).__name__}() has no {', '.join(given)}")
    if hasattr(self, "__post_init__"):
        self.__post_init__()


def _repr(self: Any) -> str:
    shown = (f"{field.name}={getattr(self, field.name)!r}" for field in self.__record__ if field.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _compared(self: Any) -> tuple[Any, ...]:
    return tuple(getattr(self, field.name) for field in self.__record__ if field.compare)


def _equal(self: Any, other: object) -> bool:
    return _compared(self) == _compared(other) if type(other) is type(self) else NotImplemented


def _hash(self: Any) -> int:
    return hash(_compared(self))


def _refuse(self: Any, name: str, value: object = None) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot change field {name!r}")
