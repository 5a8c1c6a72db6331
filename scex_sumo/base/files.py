"""Files written whole or not at all, locks of folders, temporary folders, the cache folder."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path

from scex_sumo.base.errors import ResultError

_WRITING = ".writing"


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the system in the block into a `ResultError` that names the file, else ``path``."""
    try:
        yield
    except OSError as error:
        raise ResultError(f"{error.filename or path}: cannot write: {error.strerror or error}") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary file beside ``path``, which replaces ``path`` if the block succeeds.

    Its content reaches the disk before its name does. Each process has a temporary file of its own.
    """
    # Arrow reads a relative path with a colon as a URI.
    temporary = path.absolute().with_name(f".{path.name}.{os.getpid()}{_WRITING}")
    try:
        if path.exists() and not path.is_file():
            raise ResultError(f"{path}: is {kind_of(path)}; give another name")
        yield temporary
        if temporary.exists():
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            temporary.replace(path)
    except OSError as error:
        raise ResultError(f"{path}: cannot write: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_atomic(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, as `replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def kind_of(path: Path) -> str:
    """Say what is there in place of a file."""
    return "a folder" if path.is_dir() else "no regular file"


def sha256_of(file: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def own_folder(path: Path) -> None:
    """Make a folder inside of one of ours, unless a link is there."""
    refuse_link(path)
    path.mkdir(exist_ok=True)


def refuse_link(path: Path) -> None:
    """Raise a `ResultError` for a link: what it leads to may be another's."""
    if path.is_symlink():
        raise ResultError(f"{path}: is a link; remove it, or give another folder with -o")


def refuse_special_files(folder: Path) -> None:
    """Raise a `ResultError` for a pipe, device or socket in a folder: reading it may never end."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                refuse_special_files(Path(entry.path))
            elif not (entry.is_file() or entry.is_dir()) and Path(entry.path).exists():
                raise ResultError(f"{entry.path}: is no regular file, but a pipe or a device; remove it")


def remove(path: Path) -> None:
    """Remove a file, a folder or a link, but not what it leads to; nothing may be there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


_DIGITS = 64  # of an identity, a SHA-256


def identity_in(file: Path) -> str | None:
    """Return the identity of a result in a JSON file; None if it is missing, damaged or not ours."""
    try:
        identity = json.loads(file.read_bytes())["identity"] if file.is_file() else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return identity if isinstance(identity, str) and len(identity) == _DIGITS else None


def remove_unfinished(folder: Path) -> None:
    """Remove the unfinished files of a killed process from a folder."""
    for file in folder.glob(f".*{_WRITING}"):
        file.unlink(missing_ok=True)


def cache_folder() -> Path:
    """Return the cache folder, ``~/.cache/scex-sumo`` or in ``XDG_CACHE_HOME``."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "scex-sumo"


_locked: dict[Path, int] = {}  # open descriptors


def lock(folder: Path) -> None:
    """Lock a folder against other processes until `unlock`, or until this process ends.

    This process may lock it again.
    """
    unlock(folder)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _lock_descriptor(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        raise ResultError(
            f"{folder}: another process is writing there; wait for it, or give another folder with -o"
        ) from None
    _locked[folder.resolve()] = descriptor


def unlock(folder: Path) -> None:
    """Unlock a folder, locked or not."""
    descriptor = _locked.pop(folder.resolve(), None)
    if descriptor is not None:
        os.close(descriptor)


def _lock_descriptor(descriptor: int) -> None:
    """Lock an open folder if the file system has locks; raise BlockingIOError if it is locked."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks
        pass


_PREFIX = "scex-sumo-"
_MARKER = ".scex-sumo-temporary"
_OWNER = re.compile(rb"scex-sumo process (\d+)\n")


class TemporaryFolder(tempfile.TemporaryDirectory[str]):
    """Temporary folder that a later process removes if this process is killed.

    It is locked and has a marker file with the process number. Only folders with such a marker are removed.
    """

    def __init__(self) -> None:
        _remove_abandoned()
        super().__init__(prefix=_PREFIX, ignore_cleanup_errors=True)
        descriptor = os.open(self.name, os.O_RDONLY | os.O_DIRECTORY)
        _lock_descriptor(descriptor)
        self._release = weakref.finalize(self, os.close, descriptor)
        Path(self.name, _MARKER).write_bytes(b"scex-sumo process %d\n" % os.getpid())

    def cleanup(self) -> None:
        """Remove the folder."""
        super().cleanup()
        self._release()


def _remove_abandoned() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):  # not ours to read, or gone meanwhile
            if not _is_abandoned(folder):
                continue
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                # Process numbers of another container differ: only the lock is sure.
                _lock_descriptor(descriptor)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(descriptor)


def _is_abandoned(folder: Path) -> bool:
    marker = folder / _MARKER
    if folder.is_symlink() or marker.is_symlink() or not marker.is_file():
        return False
    if {folder.stat().st_uid, marker.stat().st_uid} != {os.getuid()}:
        return False
    owner = _OWNER.fullmatch(marker.read_bytes())
    return owner is not None and not _is_alive(int(owner[1]))


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
