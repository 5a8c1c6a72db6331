"""Names and content of files, packed ones too."""

from __future__ import annotations

import contextlib
import gzip
import io
import itertools
import math
import os
import re
import shutil
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from scex_sumo.base.errors import InputError

MAX_UNPACKED_MB = 2000
MAX_RATIO, SMALL_MB = 200, 100  # of unpacked and packed bytes; recordings have 10 to 30
_LIMIT = "SCEX_MAX_UNPACKED_MB"
_BEGINNING = 2**16  # bytes; SUMO writes its configuration first


def open_binary(path: Path) -> BinaryIO:
    """Open a file to read bytes; gzip is unpacked, whatever the name.

    Reading beyond `MAX_UNPACKED_MB` or `MAX_RATIO` times a file's size is an `InputError`; the environment
    variable ``SCEX_MAX_UNPACKED_MB`` replaces both.
    """
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    return io.BufferedReader(_Unpacked(path), 2**20) if packed else path.open("rb")


def in_arrow(file: BinaryIO) -> Any:
    """Return the rest of a file in Arrow's own memory.

    Arrow's threads still release what they read from a Python file while Python ends, and abort the process.
    """
    import pyarrow as pa

    memory = pa.BufferOutputStream()
    shutil.copyfileobj(file, memory, 2**20)
    return pa.BufferReader(memory.getvalue())


class _Unpacked(io.RawIOBase):
    """Unpacked bytes of a gzip file, up to a limit, because a small file can fill any memory."""

    def __init__(self, path: Path) -> None:
        self._file, self._path, self._bytes = gzip.GzipFile(path), path, 0
        allowed = number(os.environ.get(_LIMIT))
        usual = max(SMALL_MB, MAX_RATIO * path.stat().st_size / 1e6)
        self._megabytes = allowed if allowed > 0 else min(MAX_UNPACKED_MB, usual)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        count = self._file.readinto(buffer)
        self._bytes += count
        if self._bytes > 1e6 * self._megabytes:
            raise InputError(
                f"{self._path}: more than {self._megabytes:g} MB when unpacked; set {_LIMIT}=N to read N MB"
            )
        return count

    def close(self) -> None:
        self._file.close()
        super().close()


def open_text(path: Path, *, errors: str = "strict") -> TextIO:
    """Open a file to read text, without a byte order mark; a gzip file is unpacked."""
    return io.TextIOWrapper(open_binary(path), encoding="utf-8-sig", errors=errors, newline="")


def beginning(path: Path) -> bytes:
    """First 64 KiB of a file, unpacked if it is named ``.gz``; empty if it cannot be read."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            return file.read(_BEGINNING)
    except (OSError, EOFError, zlib.error):
        return b""


_CONTENTS = (
    (b"\x89MCAP", "an MCAP recording"),
    (b"\x80", "a Python pickle"),
    (b"PK\x03\x04", "a zip archive"),
    (b"PAR1", "a Parquet table"),
    (b"\x89HDF", "an HDF5 file"),
    (b"SQLite", "an SQLite database"),
    (b"{", "JSON"),
    (b"[", "JSON"),
)


@contextlib.contextmanager
def in_memory(path: Path) -> Iterator[None]:
    """Turn a lack of memory in the block into an `InputError` that names the file that is read."""
    try:
        yield
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory; cut it, or use a larger machine") from None


def other_content(path: Path) -> str:
    """What a file is by its first bytes, if it is neither XML nor a table of text; else empty."""
    start = beginning(path).removeprefix(b"\xef\xbb\xbf").lstrip()
    return next((word for magic, word in _CONTENTS if start.startswith(magic)), "")


def refuse_unreadable(path: Path) -> None:
    """Raise an `InputError` for a pipe, a device, or a pointer of Git LFS in the place of the data."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: is no regular file; files are read more than once, so give one")
    if path.is_file() and beginning(path).startswith(b"version https://git-lfs"):
        raise InputError(f"{path}: a pointer of Git LFS, not the data; fetch them with git lfs pull")


def plain_or_packed(path: Path) -> Path | None:
    """The file, or ``FILE.gz``; None if neither exists."""
    packed = path.with_name(f"{path.name}.gz")
    return path if path.is_file() else packed if packed.is_file() else None


def all_plain_or_packed(folder: Path, pattern: str) -> list[Path]:
    """Files of a folder by a pattern of their unpacked names, sorted; the plain one of both."""
    by_name = {unpacked_name(file): file for file in folder.glob(f"{pattern}.gz")}
    by_name |= {file.name: file for file in folder.glob(pattern)}
    return [by_name[name] for name in sorted(by_name)]


def unpacked_name(path: str | Path) -> str:
    """Name of a file without ``.gz``."""
    return Path(path).name.removesuffix(".gz")


def map_name(map_path: str | Path) -> str:
    """Return the name of a map file without the ending; bytes that are not UTF-8 become ``-``."""
    name = re.sub("[\udc80-\udcff]", "-", unpacked_name(map_path))
    return Path(name).stem.removesuffix(".net")


def unique_names(names: Iterable[str], used: Iterable[str] = ()) -> list[str]:
    """Return names, none like another or like a used one: ``-2``, ``-3`` ... is added."""
    taken, unique = set(used), []
    for name in names:
        numbered = (f"{name}-{count}" for count in itertools.count(2))
        unique.append(next(free for free in itertools.chain((name,), numbered) if free not in taken))
        taken.add(unique[-1])
    return unique


def number(text: str | None) -> float:
    """Number that a text holds; nan if it holds none."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan
