"""Ranking folder: parts of moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa

from scex_sumo.base.errors import ResultError
from scex_sumo.studies.moments.folder import (
    Listing,
    MomentRef,
    StudyFolder,
    as_row,
    damaged,
    from_row,
    read_table,
    write_table,
)
from scex_sumo.studies.moments.settings import built
from scex_sumo.studies.rank.children import MomentPart, children_schema
from scex_sumo.studies.rank.exact import ExactScore
from scex_sumo.studies.rank.scores import PAIR_NUMBERS, RankSettings

REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_CHILDREN, _TRACKS, _SEEDS, _EXACT = "children", "tracks", "seeds", "exact"
_PART = re.compile(r"children-(\d+)-(\d+)\.parquet")


class RankFolder(StudyFolder):
    """Folder of a ranking under way.

    ``children/location=L/seed=S/children-FIRST-LAST.parquet`` is there whole or not at all; its tracks are
    written first.
    """

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", _SEEDS)
    kept = ("ranking.parquet", "ranking.csv", "ranking.html", _CHILDREN, _TRACKS, _SEEDS, _EXACT, REPORTS)

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
        rows = self._kept(_SEEDS, recording)
        try:
            refs = None if rows is None else tuple(MomentRef(**from_row(row)) for row in rows)
            return None if refs is None else Listing(recording=recording, moments=refs)
        except (KeyError, TypeError):
            return None

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        rows = [as_row(ref) for ref in listing.moments]
        self._save(_SEEDS, listing.recording, rows, recording=listing.recording)

    def exact(self, ref: MomentRef) -> ExactScore | None:
        """Return the exact score of a moment; None if it was not searched, or the file is damaged."""
        rows = self._kept(_EXACT, ref.moment)
        try:
            return None if rows is None else ExactScore(**rows[0])
        except (TypeError, IndexError):
            return None

    def save_exact(self, ref: MomentRef, exact: ExactScore) -> None:
        """Keep the exact score of a moment."""
        (self.path / _EXACT).mkdir(exist_ok=True)
        self._save(_EXACT, ref.moment, [asdict(exact)])

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
