"""Study folder: moments by name, tables of those that have run, failures; checked, found after a crash.

The tables of a moment count if its record names every file and the SHA-256 of each.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import time
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import ResultError, one_line
from scex_sumo.base.files import (
    own_folder,
    refuse_link,
    remove,
    remove_unfinished,
    replacing,
    sha256_of,
    write_atomic,
)
from scex_sumo.base.version import __version__
from scex_sumo.results.folder import OutputFolder, as_json
from scex_sumo.results.info import versions

_FAILED, _PARTS = "failed", "parts"
SEEDS = "seeds"
"""Folder of the moments by recording."""


@dataclass(frozen=True, kw_only=True)
class MomentRef:
    """A moment by name, unique in a study (``seed`` in files); moments of one ``location`` share a map.

    Without a case, ``case`` is empty. ``time_s`` is in the recording's clock.
    """

    moment: str
    location: str
    recording: str
    case: str
    time_s: float
    vehicles: int


Listing: TypeAlias = tuple[MomentRef, ...]
"""The moments of one recording, in order of time."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a moment, or a whole recording (without ``time_s``), has no result.

    Where a worker ``died`` the next run of the same command tries again.
    """

    moment: str
    location: str
    recording: str
    case: str = ""
    time_s: float | None = None
    vehicles: int = 0
    reason: str = ""
    died: bool = False

    @classmethod
    def of(cls, ref: MomentRef, reason: str, *, died: bool = False) -> Failure:
        """Return the failure of a moment."""
        return cls(**asdict(ref), reason=one_line(reason), died=died)


def as_row(named: MomentRef | Failure) -> dict[str, Any]:
    """Return the values under their names in files."""
    values = asdict(named)
    return {"seed": values.pop("moment"), **values}


def from_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of `MomentRef` or `Failure`; the reverse of `as_row`."""
    return {"moment": row["seed"], **{name: value for name, value in row.items() if name != "seed"}}


def moment_name(recording: str, case: str, time_s: float) -> str:
    """Name a moment by recording, case and time, in milliseconds if needed."""
    seconds = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    return plain(f"{recording}_case{case}_t{seconds}" if case else f"{recording}_t{seconds}")


def plain(name: str) -> str:
    """Replace the characters that the path of a partition would have to escape."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)


class StudyFolder(OutputFolder):
    """Folder of the moments of a study that have run, and of those that failed."""

    place: ClassVar[str]
    """Folder of the tables of a moment, from its ``ref``."""
    records: ClassVar[tuple[str, ...]] = (_FAILED, _PARTS, SEEDS)
    """Folders of small JSON files."""
    kept: ClassVar[tuple[str, ...]] = ()
    """What else another study in the same folder removes."""

    def _clear(self) -> None:
        for files in self._recorded().values():
            self._remove(files)
            for parent in (parent for name in files for parent in [*Path(name).parents][:-1]):
                with contextlib.suppress(OSError):  # it holds something
                    (self.path / parent).rmdir()
        for name in (*self.kept, *self.records):
            remove(self.path / name)

    def _prepare(self) -> None:
        """Find the moments that are whole; remove the files of others, which run again."""
        refuse_link(self.path / self.place.partition("/")[0])
        self._opened_s = time.perf_counter()
        for name in self.records:
            own_folder(self.path / name)
            remove_unfinished(self.path / name)
        self._files = self._recorded()
        for moment in [moment for moment, files in self._files.items() if not self._is_whole(files)]:
            self._remove(self._files.pop(moment))
            self._record(_PARTS, moment).unlink(missing_ok=True)  # others' files have other names

    def _recorded(self) -> dict[str, dict[str, str]]:
        """Return the SHA-256 by moment and file; a damaged record has no file."""
        files = sorted((self.path / _PARTS).glob("*.json"))
        return {file.stem: (self._load(_PARTS, file.stem) or [{}])[0] for file in files}

    def _is_whole(self, files: Mapping[str, str]) -> bool:
        paths = {name: self.path / name for name in files}
        whole = (file.is_file() and sha256_of(file) == files[name] for name, file in paths.items())
        return bool(files) and all(whole)

    def finished(self, info: Mapping[str, Any], command: Sequence[str] | None) -> dict[str, Any]:
        """Finish the folder; return what its file holds: with the command, versions and seconds, too."""
        info = {"scex_sumo": __version__, "command": list(command) if command else None, **info}
        info |= {"versions": versions(), "seconds": round(time.perf_counter() - self._opened_s, 1)}
        self.finish(info)
        return info

    def listing(self, recording: str) -> Listing | None:
        """Return the moments of a recording; None if it is not listed, or the file is damaged."""
        rows = self._load(SEEDS, recording)
        return None if rows is None else tuple(MomentRef(**from_row(row)) for row in rows)

    def save_listing(self, recording: str, listing: Listing) -> None:
        """Keep the moments of a recording."""
        self._save(SEEDS, recording, [as_row(ref) for ref in listing])

    def has(self, ref: MomentRef) -> bool:
        """Whether a moment has run."""
        return ref.moment in self._files

    def save(self, ref: MomentRef, result: Any) -> None:
        """Keep the result of a moment, see `_tables`, unless it is there.

        Its record names the tables before they are written, and is whole after that.
        """
        if self.has(ref):
            return
        tables = {self._file(ref, name): table for name, table in self._tables(result).items()}
        self._save(_PARTS, ref.moment, [dict.fromkeys(tables, "")])
        for name, table in tables.items():
            for parent in [*Path(name).parents][-2::-1]:
                own_folder(self.path / parent)
            # Of so few rows, statistics and schema would be the larger part.
            options = {"compression": "zstd", "write_statistics": False, "store_schema": False}
            with replacing(self.path / name) as temporary:
                pq.write_table(table, temporary, write_page_checksum=True, **options)
        self._files[ref.moment] = {name: sha256_of(self.path / name) for name in tables}
        self._save(_PARTS, ref.moment, [self._files[ref.moment]])

    def _tables(self, result: Any) -> Mapping[str, pa.Table]:
        """Return the tables of a result by name."""
        raise NotImplementedError

    def _file(self, ref: MomentRef, name: str) -> str:
        return f"{self.place.format(ref=ref)}/{name}.parquet"

    def _remove(self, files: Iterable[str]) -> None:
        """Remove files of the folder, but nothing behind a link."""
        root = self.path.resolve()
        for file in (self.path / name for name in files):
            if file.parent.resolve() == root / file.parent.relative_to(self.path):
                file.unlink(missing_ok=True)
                remove_unfinished(file.parent)

    def _read(self, ref: MomentRef, table: str) -> pa.Table:
        """Read a table of a moment; raise a `ResultError` if it changed since the folder was opened."""
        content, name = b"", self._file(ref, table)
        with contextlib.suppress(OSError):
            content = (self.path / name).read_bytes()
        if hashlib.sha256(content).hexdigest() != self._files[ref.moment][name]:
            raise ResultError(f"{self.path / name}: was changed meanwhile; run the same command again")
        return pq.ParquetFile(pa.BufferReader(content)).read()

    def fail(self, failure: Failure) -> None:
        """Record that a moment has no result."""
        self._save(_FAILED, failure.moment, [as_row(failure)])

    def failures(self) -> dict[str, Failure]:
        """Return failures by moment, but for damaged files: their moments run again."""
        failures = {}
        for file in sorted((self.path / _FAILED).glob("*.json")):
            if rows := self._load(_FAILED, file.stem):
                failure = Failure(**from_row(rows[0]))
                failures[failure.moment] = failure
        return failures

    def clear_failure(self, moment: str) -> None:
        """Let a moment be tried again."""
        self._record(_FAILED, moment).unlink(missing_ok=True)

    def _record(self, kind: str, name: str) -> Path:
        return self.path / kind / f"{plain(name)}.json"

    def _save(self, kind: str, name: str, rows: Sequence[dict[str, Any]]) -> None:
        """Write rows and their checksum to a small JSON file."""
        write_atomic(self._record(kind, name), _checked(kind, name, rows).encode())

    def _load(self, kind: str, name: str) -> list[dict[str, Any]] | None:
        """Return the rows of `_save`; None if the file is missing, damaged or of another name."""
        try:
            text = self._record(kind, name).read_text()
            rows: list[dict[str, Any]] = json.loads(text)["seeds"]
            return rows if text == _checked(kind, name, rows) else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None


def _checked(kind: str, name: str, rows: Sequence[dict[str, Any]]) -> str:
    content = {"of": f"{kind} {plain(name)}", "seeds": rows}
    return as_json({**content, "check": zlib.crc32(as_json(content).encode())})
