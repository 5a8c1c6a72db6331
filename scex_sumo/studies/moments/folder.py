"""Study folder: moments by name, parts that have run, failures; checked when read, found after a crash."""

from __future__ import annotations

import json
import re
import shutil
import zlib
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import ResultError, one_line
from scex_sumo.base.files import replacing, write_atomic
from scex_sumo.results.folder import OutputFolder, as_json

_FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class MomentRef:
    """A moment by name, before its seed scene is built.

    Attributes:
        moment: unique in a study, fit for a folder's name; ``seed`` in files.
        location: the site; moments of one site share a map.
        case: id of the case, or an empty string.
        time_s: in the recording's clock.
    """

    moment: str
    location: str
    recording: str
    case: str
    time_s: float
    vehicles: int


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a moment, or a whole recording, has no result.

    Attributes:
        moment: the moment's name, or the recording's.
        time_s: None for a whole recording.
        died: a worker died; the next run of the same command tries again.
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


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The moments of one recording, in order of time."""

    recording: str
    moments: tuple[MomentRef, ...]


def as_row(named: MomentRef | Failure) -> dict[str, Any]:
    """Return the values under their names in files."""
    values = asdict(named)
    return {"seed": values.pop("moment"), **values}


def from_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of `MomentRef` or `Failure`; the reverse of `as_row`."""
    return {"moment": row["seed"], **{name: value for name, value in row.items() if name != "seed"}}


def moment_name(recording: str, case: str, time_s: float) -> str:
    """Name a moment by recording, case and time, in milliseconds if needed."""
    when = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    return plain(f"{recording}_case{case}_t{when}" if case else f"{recording}_t{when}")


def plain(name: str) -> str:
    """Replace the characters that the path of a partition would have to escape."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)


class StudyFolder(OutputFolder):
    """Folder of the moments of a study that have run, and of those that failed."""

    kept: ClassVar[tuple[str, ...]]
    """Folders and files that another study in the same folder removes."""

    def _clear(self) -> None:
        for name in (*self.kept, _FAILED):
            path = self.path / name
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)

    def _prepare(self) -> None:
        (self.path / _FAILED).mkdir(exist_ok=True)

    def fail(self, failure: Failure) -> None:
        """Record that a moment has no result."""
        self._save(_FAILED, failure.moment, [as_row(failure)])

    def failures(self) -> dict[str, Failure]:
        """Return failures by moment; damaged files are removed, so that their moments run again."""
        found = {}
        for file in sorted((self.path / _FAILED).glob("*.json")):
            try:
                rows = self._kept(_FAILED, file.stem) or []
                failure = Failure(**from_row(rows[0]))
                found[failure.moment] = failure
            except (IndexError, KeyError, TypeError):
                file.unlink()
        return found

    def clear_failure(self, moment: str) -> None:
        """Let a moment be tried again."""
        self._record(_FAILED, moment).unlink(missing_ok=True)

    def _record(self, kind: str, name: str) -> Path:
        return self.path / kind / f"{plain(name)}.json"

    def _save(self, kind: str, name: str, rows: Sequence[dict[str, Any]], **more: str) -> None:
        """Write rows and their checksum to a small JSON file."""
        content = {**more, "seeds": rows, "check": _checksum(rows)}
        write_atomic(self._record(kind, name), as_json(content).encode())

    def _kept(self, kind: str, name: str) -> list[dict[str, Any]] | None:
        """Return the rows of `_save`; None if the file is missing or damaged."""
        try:
            content = json.loads(self._record(kind, name).read_text())
            rows: list[dict[str, Any]] = content["seeds"]
            return rows if content["check"] == _checksum(rows) else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None


def _checksum(rows: Sequence[dict[str, Any]]) -> int:
    return zlib.crc32(as_json({"seeds": rows}).encode())


def write_table(file: Path, table: pa.Table, **options: Any) -> None:
    """Write a Parquet table and its folder."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as temporary:
        pq.write_table(table, temporary, compression="zstd", write_page_checksum=True, **options)


def read_table(file: Path, schema: pa.Schema, undefined: Collection[str] = ()) -> pa.Table:
    """Read a kept table; check pages, columns, types, and nulls outside of ``undefined`` columns."""
    try:
        table = pq.ParquetFile(file.absolute(), page_checksum_verification=True).read()
    except (OSError, ValueError, pa.ArrowException) as error:
        raise damaged(file, f"cannot be read ({one_line(error)})") from None
    for field in schema:
        if table.column_names.count(field.name) != 1:
            raise damaged(file, f"has no single column {field.name}")
        column = table[field.name]
        if column.type != field.type:
            raise damaged(file, f"column {field.name} has type {column.type}, needs {field.type}")
        values = column.combine_chunks()
        lists = pa.types.is_list(field.type)
        if field.name not in undefined and (values.null_count or (lists and values.flatten().null_count)):
            raise damaged(file, f"column {field.name} has empty values")
    return table.select(schema.names)


def damaged(file: Path, what: str) -> ResultError:
    """Return the error of a kept file that cannot be used."""
    return ResultError(f"{file}: {what}; remove it and run again")
