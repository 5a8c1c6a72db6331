"""Folder of a ranking: parts of moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import io
import json
import re
import shutil
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.arrays import IntArray
from scex_sumo.errors import ResultError
from scex_sumo.files import write_atomic
from scex_sumo.ranking.moments import Failure, Listing, MomentRef, as_row, from_row, plain, read_failures
from scex_sumo.ranking.run_moment import MomentPart
from scex_sumo.results.claimed import ClaimedFolder, as_json

INFO = "rank.json"
_CHILDREN, _TRACKS, _SEEDS, _FAILED = "children", "tracks", "seeds", "failed"
REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_PART = re.compile(r"children-(\d+)-(\d+)\.parquet")
_OURS = ("ranking.parquet", "ranking.csv", "ranking.html")


class RankFolder(ClaimedFolder):
    """Holds what a ranking has found so far.

    ``children/location=L/seed=S/children-FIRST-LAST.parquet`` is there whole or not at all: whoever finds it
    need not run these children again. Tracks are written before the children that they belong to.
    """

    info, what = INFO, "ranking"
    another = "another ranking, of other recordings or with other options"

    def _clear(self) -> None:
        for name in _OURS:
            (self.path / name).unlink(missing_ok=True)
        for name in (_CHILDREN, _TRACKS, _SEEDS, _FAILED, REPORTS):
            shutil.rmtree(self.path / name, ignore_errors=True)

    def _prepare(self) -> None:
        for name in (_CHILDREN, _SEEDS, _FAILED):
            (self.path / name).mkdir(exist_ok=True)
        self._parts = dict(self._scan())

    def _scan(self) -> Iterator[tuple[str, dict[int, int]]]:
        """Parts by moment; those that cannot be read whole are removed, their children run again."""
        for folder in (self.path / _CHILDREN).glob("location=*/seed=*"):
            spans = {}
            for file in sorted(folder.iterdir()):
                named = _PART.fullmatch(file.name)
                if named and not _is_whole(file, int(named[1]), int(named[2])):
                    file.unlink()
                elif named:
                    spans[int(named[1])] = int(named[2]) + 1
            yield folder.name.removeprefix("seed="), spans

    def listing(self, recording: str) -> Listing | None:
        """The moments of a recording, or None where it has not been looked at."""
        file = self._listing_file(recording)
        if not file.is_file():
            return None
        try:
            content = json.loads(file.read_text())
            rows = content["seeds"]
            if content["check"] != _check(rows):
                return None
            return Listing(recording=recording, moments=tuple(MomentRef(**from_row(row)) for row in rows))
        except (ValueError, KeyError, TypeError):
            return None  # cut short or edited: looked at again

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        rows = [as_row(ref) for ref in listing.moments]
        content = {"recording": listing.recording, "seeds": rows, "check": _check(rows)}
        write_atomic(self._listing_file(listing.recording), as_json(content).encode())

    def _listing_file(self, recording: str) -> Path:
        return self.path / _SEEDS / f"{plain(recording)}.json"

    def has(self, ref: MomentRef, first: int) -> bool:
        """Whether the part of a moment that begins with a child is there."""
        return first in self._parts.get(ref.moment, {})

    def append(self, ref: MomentRef, part: MomentPart) -> None:
        """Add children of a moment; those that are there stay as they are."""
        first, last = int(part.children[0]), int(part.children[-1])
        if self.has(ref, first):
            return
        if part.tracks is not None:
            _write(self._part_file(_TRACKS, ref, first, last), part.tracks)
        _write(self._part_file(_CHILDREN, ref, first, last), children_table(part))
        self._parts.setdefault(ref.moment, {})[first] = last + 1

    def _part_file(self, kind: str, ref: MomentRef, first: int, last: int) -> Path:
        name = f"children-{first:05d}-{last:05d}.parquet"
        return self.path / kind / f"location={ref.location}" / f"seed={ref.moment}" / name

    def read(self, ref: MomentRef, first: int) -> pa.Table:
        """The part of a moment that begins with a child: columns of `children_table`.

        Raises:
            ResultError: it cannot be read.
        """
        file = self._part_file(_CHILDREN, ref, first, self._parts[ref.moment][first] - 1)
        try:
            return pq.ParquetFile(file).read()
        except (OSError, pa.ArrowException) as error:
            raise ResultError(f"{file}: cannot be read: {error}; remove it and run again") from None

    def fail(self, failure: Failure) -> None:
        """Record that a moment has no result."""
        write_atomic(self._failure_file(failure.moment), as_json(as_row(failure)).encode())

    def failures(self) -> dict[str, Failure]:
        """What failed, by moment."""
        return read_failures(self.path / _FAILED)

    def clear_failure(self, moment: str) -> None:
        """Let a moment be tried again."""
        self._failure_file(moment).unlink(missing_ok=True)

    def _failure_file(self, moment: str) -> Path:
        return self.path / _FAILED / f"{moment}.json"


def _check(rows: Sequence[dict[str, Any]]) -> int:
    """Checksum of a listing's rows."""
    return zlib.crc32(as_json({"seeds": rows}).encode())


def _is_whole(file: Path, first: int, last: int) -> bool:
    """Whether a part holds the children that its name says."""
    try:
        table = pq.ParquetFile(file).read()
    except (OSError, pa.ArrowException, ValueError):
        return False
    known = {"child", "fallbacks", "kept", "track_id", "model", "critical_pairs"}.issubset(table.column_names)
    return known and table["child"].to_pylist() == list(range(first, last + 1))


def children_table(part: MomentPart) -> pa.Table:
    """Rows of a moment's children.

    Columns: child, the metrics, fallbacks, kept, the lists track_id and model, one of each for every vehicle,
    and critical_pairs, four numbers for each critical encounter, see `MomentPart`.
    """
    data: dict[str, Any] = {"child": pa.array(part.children, pa.int32())}
    for index, name in enumerate(part.columns):
        data[name] = pa.array(part.values[:, index], mask=~part.defined[:, index])
    data["fallbacks"] = pa.array(part.fallbacks, pa.int32())
    data["kept"] = part.kept
    data["track_id"] = pa.array([part.track_ids.tolist()] * len(part.children), pa.list_(pa.int64()))
    data["model"] = pa.array([list(row) for row in part.models], pa.list_(pa.string()))
    data["critical_pairs"] = pa.array([rows.reshape(-1) for rows in part.pairs], pa.list_(pa.int64()))
    return pa.table(data)


def pairs_of(table: pa.Table) -> list[IntArray]:
    """For each child its critical encounters, as `MomentPart` has them."""
    return [np.asarray(row, dtype=np.int64).reshape(-1, 4) for row in table["critical_pairs"].to_pylist()]


def _write(path: Path, table: pa.Table) -> None:
    """Write a small Parquet file: of so few rows, statistics and schema would be the larger part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd", write_statistics=False, store_schema=False)
    write_atomic(path, sink.getvalue())
