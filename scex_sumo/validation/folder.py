"""Folder of a validation: moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.errors import ResultError
from scex_sumo.files import replacing, write_atomic
from scex_sumo.ranking.moments import Failure, MomentRef, as_row, read_failures
from scex_sumo.results.claimed import ClaimedFolder
from scex_sumo.validation.moment import CONSTANT_VELOCITY, RECORDED, SEED_MOMENT, Forecast

INFO = "validate.json"
_TABLES = ("vehicles", "encounters", "realism", "seen", "children")  # the last one says that all are there
_MOMENTS, _FAILED = "moments", "failed"


class ForecastFolder(ClaimedFolder):
    """Holds the forecasts of the moments that have run: ``moments/NAME/children.parquet`` and three more."""

    info, what, another = INFO, "validation", "another validation"

    def _clear(self) -> None:
        for name in (_MOMENTS, _FAILED):
            shutil.rmtree(self.path / name, ignore_errors=True)

    def _prepare(self) -> None:
        """Moments and failures that cannot be read whole are removed, and run again."""
        (self.path / _FAILED).mkdir(exist_ok=True)
        for folder in (self.path / _MOMENTS).glob("*/"):
            if not _is_whole(folder):
                shutil.rmtree(folder)

    def restart(self) -> None:
        """Forget the moments that have run."""
        self._clear()
        self._prepare()

    def has(self, ref: MomentRef) -> bool:
        """Whether a moment has run."""
        return (self.path / _MOMENTS / ref.moment).is_dir()

    def append(self, ref: MomentRef, forecast: Forecast) -> None:
        """Add the forecast of a moment."""
        folder = self.path / _MOMENTS / ref.moment
        folder.mkdir(parents=True, exist_ok=True)
        for name in _TABLES:
            with replacing(folder / f"{name}.parquet") as file:
                pq.write_table(getattr(forecast, name), file, compression="zstd", write_page_checksum=True)

    def read(self, ref: MomentRef) -> Forecast:
        """The forecast of a moment that has run.

        Raises:
            ResultError: it cannot be read.
        """
        folder, tables = self.path / _MOMENTS / ref.moment, dict[str, pa.Table]()
        for name in _TABLES:
            try:
                tables[name] = _read(folder / f"{name}.parquet")
            except (OSError, pa.ArrowException) as error:
                raise ResultError(f"{folder}: cannot be read: {error}; remove it and run again") from None
        return Forecast(**tables)

    def fail(self, failure: Failure) -> None:
        """Record that a moment has no forecast."""
        content = json.dumps(as_row(failure)) + "\n"
        write_atomic(self.path / _FAILED / f"{failure.moment}.json", content.encode())

    def failures(self) -> dict[str, Failure]:
        """What failed, by moment."""
        return read_failures(self.path / _FAILED)


def _read(file: Path) -> pa.Table:
    return pq.ParquetFile(file, page_checksum_verification=True).read()


def _is_whole(folder: Path) -> bool:
    """Whether all tables of a moment can be read, with its children and what they are compared to."""
    try:
        tables = {name: _read(folder / f"{name}.parquet") for name in _TABLES}
        rows = tables["children"]["child"].to_pylist()
        known = len(tables["realism"]["realism"]) == 1
    except (OSError, KeyError, ValueError, pa.ArrowException):
        return False
    return known and rows == [*range(len(rows) - 3), RECORDED, CONSTANT_VELOCITY, SEED_MOMENT]
