"""Cache of the user: what was made of the same input by the same code is there for the next run.

Whatever is kept is found under a hash of what it was made of and of our very modules, so that neither another
input nor another version finds it. It is there whole or not at all, whoever else writes it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from scex_sumo.errors import ResultError
from scex_sumo.files import cache_folder, replacing
from scex_sumo.version import __version__

MOST = 64  # of a kind; those not used for longest go first


def place_of(kind: str, made_of: object) -> Path:
    """Where in the cache something is; ``made_of`` is all that decides on it, and can be pickled."""
    made_by = (__version__, np.__version__, _modules())
    return cache_folder() / kind / hashlib.sha256(pickle.dumps((made_by, made_of))).hexdigest()


@cache
def _modules() -> str:
    """The state of our own modules: who changes one must not get what it made before."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return repr([(file.name, (found := file.stat()).st_size, found.st_mtime_ns) for file in files])


def kept_arrays(
    kind: str, made_of: object, make: Callable[[], Mapping[str, NDArray[Any]]]
) -> Mapping[str, NDArray[Any]]:
    """Arrays that ``make`` gives, from the cache where it has them."""
    place = place_of(kind, made_of).with_suffix(".npz")
    with contextlib.suppress(OSError, EOFError, ValueError, KeyError, BadZipFile):  # not there, or not whole
        with place.open("rb") as opened, np.load(opened) as file:
            found = {name: file[name] for name in file.files}
        os.utime(place)
        return found
    made: dict[str, Any] = dict(make())
    with contextlib.suppress(OSError, ResultError):  # a full disk, or a home that cannot be written
        place.parent.mkdir(parents=True, exist_ok=True)
        with replacing(place) as temporary, temporary.open("wb") as new:
            np.savez(new, **made)
        forget_old(place.parent)
    return made


def forget_old(folder: Path) -> None:
    """Remove what is too much of a kind."""
    for old in sorted((p for p in folder.iterdir() if not p.name.startswith(".")), key=_last_used)[:-MOST]:
        shutil.rmtree(old, ignore_errors=True) if old.is_dir() else old.unlink(missing_ok=True)


def _last_used(place: Path) -> float:
    try:
        return place.stat().st_mtime
    except OSError:  # removed meanwhile
        return 0.0
