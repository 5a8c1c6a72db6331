"""Files that are there whole or not at all, and folders that one process at a time writes into."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from scex_sumo.errors import ResultError


def write_atomic(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    temporary = path.with_name(f".{path.name}.writing")
    temporary.write_bytes(content)
    temporary.replace(path)


_locked: dict[Path, int] = {}  # open descriptors; the system lets go of them when the process ends, however


def lock(folder: Path) -> None:
    """Keep other processes out of a folder until `unlock`, or until this one ends.

    A folder that this process holds already stays held, so that a run that failed can be repeated.

    Raises:
        ResultError: another process holds it.
    """
    unlock(folder)
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
        _locked[folder.resolve()] = descriptor


def unlock(folder: Path) -> None:
    """Let other processes in."""
    descriptor = _locked.pop(folder.resolve(), None)
    if descriptor is not None:
        os.close(descriptor)
