"""Derived tables: what is computed once from a road, a scene or a history, and goes with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

MOST_OWNERS = 16  # of a class: the least recently used one is forgotten first
Owner = TypeVar("Owner")
P = ParamSpec("P")
Made = TypeVar("Made")

_made: dict[type, WeakKeyDictionary[Any, dict[Any, Any]]] = {}
_lock = Lock()  # a ranking reads ahead in a thread


def derived(make: Callable[Concatenate[Owner, P], Made]) -> Callable[Concatenate[Owner, P], Made]:
    """Decorator for a function of an owner: each result is kept as long as the owner is, by identity.

    The result must not refer to the owner, or neither would ever go. It is shared: nobody changes it.

    Args:
        make: computes from the owner and, where there are any, further arguments that can be hashed.
    """

    @wraps(make)
    def remembered(owner: Owner, /, *args: P.args, **options: P.kwargs) -> Made:
        kept = _kept(owner)
        key = (make, *args, *sorted(options.items()))
        if key not in kept:
            kept[key] = make(owner, *args, **options)
        made: Made = kept[key]
        return made

    return remembered


def _kept(owner: Any) -> dict[Any, Any]:
    """What is kept of an owner, which is now the most recently used one."""
    with _lock:
        owners = _made.setdefault(type(owner), WeakKeyDictionary())
        kept = owners.pop(owner, {})
        owners[owner] = kept
        if len(owners) > MOST_OWNERS:
            del owners[next(iter(owners))]
    return kept
