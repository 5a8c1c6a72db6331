"""Files that the user named: no input and no file of others is replaced; tables as Parquet or CSV."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import cache_folder, kind_of, replacing, sha256_of, write_atomic, writing

if TYPE_CHECKING:
    import pyarrow as pa

_WRITTEN, _MOST_WRITTEN = "written", 20_000
TABLE_SUFFIXES = (".parquet", ".csv")


@contextlib.contextmanager
def output(path: Path, *inputs: Path | None) -> Iterator[Path]:
    """Yield a temporary file for a file that the user named, as `replacing`; see `check_output`."""
    target = check_output(path, *inputs)
    with writing(path):
        target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as temporary:
        yield temporary
    remember(target)


def write_output(path: Path, content: bytes, *inputs: Path | None) -> None:
    """Write a file that the user named, as `output`."""
    with output(path, *inputs) as temporary:
        temporary.write_bytes(content)


def check_output(path: Path, *inputs: Path | None) -> Path:
    """Return the file that a path, or the link there, leads to.

    Raises:
        ResultError: it is an input, no regular file, or one that this program did not write as it is.
    """
    try:
        target = path.resolve()
        if not path.exists():
            return target
        if not path.is_file():  # a pipe of /dev/stdout has no file as its target
            raise ResultError(f"{path}: is {kind_of(path)}; give the name of a file")
        if any(file is not None and file.exists() and target.samefile(file) for file in inputs):
            raise ResultError(f"{path}: is an input of this command; give another name")
        if _fingerprint(target) not in _written():
            raise ResultError(
                f"{path}: exists, and not as scex-sumo wrote it; give another name, or remove it"
            )
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle
        raise ResultError(f"{path}: cannot write: {getattr(error, 'strerror', None) or error}") from None
    return target


def remember(*files: Path) -> None:
    """Let files that were written where the user named them be replaced by the next command."""
    with contextlib.suppress(OSError, ResultError):  # without a cache they are not replaced
        written, known = cache_folder() / _WRITTEN, _written()
        written.parent.mkdir(parents=True, exist_ok=True)
        if len(known) > _MOST_WRITTEN:
            write_atomic(written, "".join(f"{name}\n" for name in known[_MOST_WRITTEN // 2 :]).encode())
        with written.open("a") as lines:
            lines.writelines(f"{_fingerprint(file.resolve())}\n" for file in files if file.is_file())


def _written() -> list[str]:
    """Return the fingerprints of files that this program wrote where the user named them."""
    try:
        return (cache_folder() / _WRITTEN).read_text().split()
    except (OSError, UnicodeDecodeError):
        return []


def _fingerprint(file: Path) -> str:
    return hashlib.sha256(f"{sha256_of(file)} {file}".encode(errors="surrogateescape")).hexdigest()


def write_table(table: pa.Table, path: Path, *inputs: Path) -> None:
    """Write a table as Parquet or CSV, as `output`."""
    import pyarrow.parquet as pq

    with output(path, *inputs) as temporary:
        if path.suffix == ".parquet":
            pq.write_table(table, temporary)
        else:
            with temporary.open("wb") as file:
                write_csv(table, file)


def write_csv(table: pa.Table, file: Any) -> None:
    """Write a table as CSV to an open binary file."""
    from pyarrow import csv

    csv.write_csv(table, file, csv.WriteOptions(quoting_style="needed"))
    file.flush()
