"""Kept between runs, in the user's cache: what is made of the same by the same code is made once."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from scex_sumo.errors import ResultError
from scex_sumo.files import cache_folder, write_atomic

Made = TypeVar("Made")

_DIGEST = 32  # bytes of a SHA-256
_KNOWN = {
    *((f"numpy.{core}.numeric", "_frombuffer") for core in ("_core", "core")),  # from NumPy 2 on, and before
    *((f"numpy.{core}.multiarray", "_reconstruct") for core in ("_core", "core")),
    *(("numpy", "dtype"), ("numpy", "ndarray"), ("pathlib", "PosixPath")),
}


def kept(kind: str, made_of: bytes, make: Callable[[], bytes], *, most: int = 64) -> bytes:
    """What ``make`` gives, from the user's cache where it was made of the same before.

    Args:
        kind: folder of the cache.
        made_of: everything that the result depends on but our own code and NumPy, which are added.
        make: makes it.
        most: how many of this kind are kept; those not used for longest go first.
    """
    place = cache_folder() / kind / hashlib.sha256(our_modules() + made_of).hexdigest()
    with contextlib.suppress(OSError):  # not there
        found = place.read_bytes()
        if found[:_DIGEST] == hashlib.sha256(found[_DIGEST:]).digest():  # whole
            os.utime(place)
            return found[_DIGEST:]
    made = make()
    with contextlib.suppress(OSError, ResultError):  # a full disk stops no run
        place.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(place, hashlib.sha256(made).digest() + made)
        for old in sorted(place.parent.iterdir(), key=lambda file: file.stat().st_mtime)[:-most]:
            old.unlink(missing_ok=True)
    return made


def kept_object(kind: str, made_of: bytes, make: Callable[[], Made], parts: tuple[type, ...]) -> Made:
    """What ``make`` gives, as `kept` keeps it, unpickled from nothing but arrays and its own classes.

    Args:
        kind: folder of the cache.
        made_of: as for `kept`.
        make: makes it.
        parts: the classes that it consists of.
    """
    packed = kept(kind, made_of, lambda: pickle.dumps(make(), protocol=5))
    try:
        made: Made = _Reader(packed, parts).load()
    except pickle.UnpicklingError:  # somebody else's
        return make()
    return made


class _Reader(pickle.Unpickler):
    """Reads objects of some classes and nothing else, whoever wrote into the cache."""

    def __init__(self, packed: bytes, parts: tuple[type, ...]) -> None:
        super().__init__(io.BytesIO(packed))
        self._known = _KNOWN | {(part.__module__, part.__name__) for part in parts}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self._known:
            raise pickle.UnpicklingError(f"{module}.{name} is not expected")
        return super().find_class(module, name)


@cache
def our_modules() -> bytes:
    """The state of our own modules and NumPy: who changes one must not get what it made before."""
    state, folders = [], [str(Path(__file__).parent)]
    for folder in folders:
        for entry in os.scandir(folder):
            if entry.name.endswith(".py"):
                at = entry.stat()
                state.append((entry.name, at.st_size, at.st_mtime_ns))
            elif entry.is_dir() and entry.name != "__pycache__":
                folders.append(entry.path)
    return repr((np.__version__, sorted(state))).encode()
