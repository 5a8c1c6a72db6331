"""One process at a time writes into a folder."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from scex_sumo.errors import ResultError

_held: dict[Path, int] = {}  # open descriptors; the system lets go of them when the process ends, however


def hold(folder: Path) -> None:
    """Keep other processes out of a folder until `let_go`, or until this one ends.

    A folder that this process holds already stays held, so that a run that failed can be repeated.

    Raises:
        ResultError: another process holds it.
    """
    let_go(folder)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ResultError(
            f"{folder}: another process is writing there; wait for it, or give another folder with -o"
        ) from None
    except OSError:  # a file system without locks
        os.close(descriptor)
    else:
        _held[folder.resolve()] = descriptor


def let_go(folder: Path) -> None:
    """Let other processes in."""
    descriptor = _held.pop(folder.resolve(), None)
    if descriptor is not None:
        os.close(descriptor)
