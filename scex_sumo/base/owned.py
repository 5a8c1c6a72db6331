"""Cache in memory: what is made of a road, scene or history, while it lives."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary, ref

Made = TypeVar("Made")
Key = TypeVar("Key")
Owner = TypeVar("Owner")
P = ParamSpec("P")

MAX_OWNERS = 16  # of a class

_by_owner: dict[type, WeakKeyDictionary[Any, dict[Any, Any]]] = {}
_latest: dict[type, ref[Any]] = {}
_owner_lock = Lock()  # `rank` reads recordings in a thread


class SentOnce:
    """Base of immutable objects of which a worker keeps its copy, with all that is cached for it."""


def owner_cache(make: Callable[Concatenate[Owner, P], Made]) -> Callable[Concatenate[Owner, P], Made]:
    """Decorate a function of an owner: its results are kept in memory while the owner lives.

    Further arguments must be hashable. A result is shared: nobody may change it, and it must not refer to its
    owner.
    """

    @wraps(make)
    def cached(owner: Owner, /, *args: P.args, **options: P.kwargs) -> Made:
        results = _results_of(owner)
        key = (make, *args, *sorted(options.items()))
        if key not in results:
            results[key] = make(owner, *args, **options)
        result: Made = results[key]
        return result

    return cached


def _results_of(owner: Any) -> dict[Any, Any]:
    latest = _latest.get(type(owner))
    known = _by_owner[type(owner)].get(owner) if latest is not None and latest() is owner else None
    if known is not None:  # the usual case needs no lock
        return known
    with _owner_lock:
        owners = _by_owner.setdefault(type(owner), WeakKeyDictionary())
        results = owners.pop(owner, {})
        owners[owner] = results
        if len(owners) > MAX_OWNERS:
            del owners[next(iter(owners))]
        _latest[type(owner)] = ref(owner)
    return results


def recent(known: dict[Key, Made], key: Key, most: int, make: Callable[[], Made]) -> Made:
    """Return the value of a key; the oldest goes where there are ``most``."""
    if key not in known:
        result = make()
        while len(known) >= most:
            del known[next(iter(known))]
        known[key] = result
    return known[key]
