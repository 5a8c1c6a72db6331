"""File writing that leaves a file whole or not at all, locks of folders, temporary folders, XML values."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path

from scex_sumo.errors import ResultError

_WRITING = ".writing"
_REFERENCES = (
    *(("&", "&amp;"), (">", "&gt;"), ("<", "&lt;")),
    *(("\n", "&#10;"), ("\r", "&#13;"), ("\t", "&#9;")),
)

_REFERRED = re.compile('["&<>\n\r\t]').search


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """What is written in the block is a file, or goes into a folder; errors of the system name it.

    Raises:
        ResultError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise ResultError(f"{error.filename or path}: cannot write: {error.strerror or error}") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file beside ``path`` to write to, which takes its place when the block ends well.

    Its content reaches the disk before its name does: after a power loss ``path`` is whole or as it was.

    Raises:
        ResultError: the file cannot be written; names it.
    """
    temporary = path.with_name(f".{path.name}{_WRITING}")
    try:
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
    """Write a file so that it is there whole or not at all, as `replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def remove_unfinished(folder: Path) -> None:
    """Remove what a process that was killed had begun to write in a folder."""
    for file in folder.glob(f".*{_WRITING}"):
        file.unlink(missing_ok=True)


_locked: dict[Path, int] = {}  # open descriptors; the system lets go of them when the process ends, however


def cache_folder() -> Path:
    """Where things are kept between runs: ``~/.cache/scex-sumo``, or as ``XDG_CACHE_HOME`` says."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "scex-sumo"


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


def quoted(text: str) -> str:
    """A value of an XML attribute in its quotes, as `xml.sax.saxutils.quoteattr`, which loads ``urllib``."""
    if not _REFERRED(text):
        return f'"{text}"'
    for plain, reference in _REFERENCES:
        text = text.replace(plain, reference)
    if '"' not in text:
        return f'"{text}"'
    return f"'{text}'" if "'" not in text else '"' + text.replace('"', "&quot;") + '"'


class TemporaryFolder(tempfile.TemporaryDirectory[str]):
    """A temporary folder that the next process removes where this one is killed.

    Its name has the process's number, and the process holds a lock of it.
    """

    def __init__(self) -> None:
        _remove_abandoned()
        super().__init__(prefix=f"scex-{os.getpid()}-", ignore_cleanup_errors=True)
        self._let_go = weakref.finalize(self, os.close, _locked_descriptor(self.name))

    def cleanup(self) -> None:
        """Remove the folder."""
        super().cleanup()
        self._let_go()


_OWNED = re.compile(r"scex-(\d+)-.+")


def _remove_abandoned() -> None:
    """Remove temporary folders of processes that ended without."""
    for folder in Path(tempfile.gettempdir()).glob("scex-*"):
        owner = _OWNED.fullmatch(folder.name)
        if owner is None or _is_alive(int(owner[1])) or not folder.is_dir() or folder.is_symlink():
            continue
        try:
            # A process of another container has a number that says nothing here, but the lock does.
            descriptor = _locked_descriptor(str(folder))
        except OSError:
            continue
        shutil.rmtree(folder, ignore_errors=True)
        os.close(descriptor)


def _locked_descriptor(folder: str) -> int:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # a file system without locks
        pass
    return descriptor


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
