"""Ranking folder: parts of moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import write_atomic
from scex_sumo.results.output_folder import as_json
from scex_sumo.studies.moments.folder import (
    Listing,
    MomentRef,
    StudyFolder,
    as_row,
    checksum,
    damaged,
    from_row,
    plain,
    read_record,
    read_table,
    write_table,
)
from scex_sumo.studies.moments.settings import built
from scex_sumo.studies.rank.children import PAIR_NUMBERS, MomentPart, children_schema
from scex_sumo.studies.rank.settings import RankSettings

REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_CHILDREN, _TRACKS, _SEEDS = "children", "tracks", "seeds"
_PART = re.compile(r"children-(\d+)-(\d+)\.parquet")


class RankFolder(StudyFolder):
    """Folder of a ranking under way.

    ``children/location=L/seed=S/children-FIRST-LAST.parquet`` is there whole or not at all; its tracks are
    written first.
    """

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", _SEEDS)
    kept = (*(f"ranking.{end}" for end in ("parquet", "csv", "html")), _CHILDREN, _TRACKS, _SEEDS, REPORTS)

    def __init__(
        self, path: Path, identity: Mapping[str, Any], settings: RankSettings, *, overwrite: bool = False
    ) -> None:
        self._columns = settings.run.columns
        self._schema = children_schema(self._columns)
        self._models = {str(spec) for spec in built(settings.models).drawn}
        super().__init__(path, identity, overwrite=overwrite)

    def _prepare(self) -> None:
        super()._prepare()
        (self.path / _SEEDS).mkdir(exist_ok=True)
        self._parts = dict(self._scan())

    def _scan(self) -> Iterator[tuple[str, dict[int, int]]]:
        for folder in (self.path / _CHILDREN).glob("location=*/seed=*"):
            spans = {}
            for file in sorted(folder.iterdir()):
                named = _PART.fullmatch(file.name)
                if named is None:
                    continue
                try:
                    self._read(file)
                except ResultError:
                    file.unlink()
                else:
                    spans[int(named[1])] = int(named[2]) + 1
            yield folder.name.removeprefix("seed="), spans

    def listing(self, recording: str) -> Listing | None:
        """Return the moments of a recording; None if it is not listed, or the file is damaged."""
        content = read_record(self._listing_file(recording))
        try:
            rows = content["seeds"]
            if content["check"] != checksum(rows):
                return None
            return Listing(recording=recording, moments=tuple(MomentRef(**from_row(row)) for row in rows))
        except (KeyError, TypeError):
            return None

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        rows = [as_row(ref) for ref in listing.moments]
        content = {"recording": listing.recording, "seeds": rows, "check": checksum(rows)}
        write_atomic(self._listing_file(listing.recording), as_json(content).encode())

    def _listing_file(self, recording: str) -> Path:
        return self.path / _SEEDS / f"{plain(recording)}.json"

    def has(self, ref: MomentRef, first: int) -> bool:
        """Whether the part of a moment that begins with child ``first`` is there."""
        return first in self._parts.get(ref.moment, {})

    def append(self, ref: MomentRef, part: MomentPart) -> None:
        """Add children of a moment, unless they are there."""
        numbers = part.children["child"]
        first, last = numbers[0].as_py(), numbers[-1].as_py()
        if self.has(ref, first):
            return
        # Of so few rows, statistics and schema would be the larger part.
        small = {"write_statistics": False, "store_schema": False}
        if part.tracks is not None:
            write_table(self._part_file(_TRACKS, ref, first, last), part.tracks, **small)
        write_table(self._part_file(_CHILDREN, ref, first, last), part.children, **small)
        self._parts.setdefault(ref.moment, {})[first] = last + 1

    def _part_file(self, kind: str, ref: MomentRef, first: int, last: int) -> Path:
        name = f"children-{first:05d}-{last:05d}.parquet"
        return self.path / kind / f"location={ref.location}" / f"seed={ref.moment}" / name

    def read(self, ref: MomentRef, first: int) -> pa.Table:
        """Read the part of a moment that begins with child ``first``."""
        return self._read(self._part_file(_CHILDREN, ref, first, self._parts[ref.moment][first] - 1))

    def _read(self, file: Path) -> pa.Table:
        table, named = read_table(file, self._schema, self._columns), _PART.fullmatch(file.name)
        assert named is not None
        if table["child"].to_pylist() != list(range(int(named[1]), int(named[2]) + 1)):
            raise damaged(file, "has other futures than its name says")
        tracks, models = table["track_id"].to_pylist(), table["model"].to_pylist()
        if any(row != tracks[0] for row in tracks) or any(len(row) != len(tracks[0]) for row in models):
            raise damaged(file, "has rows with other vehicles")
        if not self._models.issuperset(name for row in models for name in row):
            raise damaged(file, f"has models other than {', '.join(sorted(self._models))}")
        if any(len(row) % PAIR_NUMBERS for row in table["critical_pairs"].to_pylist()):
            raise damaged(file, "column critical_pairs has incomplete rows")
        return table
