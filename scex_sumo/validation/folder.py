"""Folder of a validation: moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import json
import shutil

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.errors import ResultError
from scex_sumo.files import replacing, write_atomic
from scex_sumo.ranking.moments import Failure, MomentRef, as_row, from_row
from scex_sumo.results.claimed import ClaimedFolder
from scex_sumo.validation.moment import Forecast

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
        (self.path / _FAILED).mkdir(exist_ok=True)

    def restart(self) -> None:
        """Forget the moments that have run."""
        self._clear()
        self._prepare()

    def has(self, ref: MomentRef) -> bool:
        """Whether a moment has run."""
        return (self.path / _MOMENTS / ref.moment / f"{_TABLES[-1]}.parquet").is_file()

    def append(self, ref: MomentRef, forecast: Forecast) -> None:
        """Add the forecast of a moment."""
        folder = self.path / _MOMENTS / ref.moment
        folder.mkdir(parents=True, exist_ok=True)
        for name in _TABLES:
            with replacing(folder / f"{name}.parquet") as file:
                pq.write_table(getattr(forecast, name), file, compression="zstd")

    def read(self, ref: MomentRef) -> Forecast:
        """The forecast of a moment that has run.

        Raises:
            ResultError: it cannot be read.
        """
        folder, tables = self.path / _MOMENTS / ref.moment, dict[str, pa.Table]()
        for name in _TABLES:
            try:
                tables[name] = pq.ParquetFile(folder / f"{name}.parquet").read()
            except (OSError, pa.ArrowException) as error:
                raise ResultError(f"{folder}: cannot be read: {error}; remove it and run again") from None
        return Forecast(**tables)

    def fail(self, failure: Failure) -> None:
        """Record that a moment has no forecast."""
        content = json.dumps(as_row(failure)) + "\n"
        write_atomic(self.path / _FAILED / f"{failure.moment}.json", content.encode())

    def failures(self) -> dict[str, Failure]:
        """What failed, by moment."""
        files = sorted((self.path / _FAILED).glob("*.json"))
        found = [Failure(**from_row(json.loads(file.read_text()))) for file in files]
        return {failure.moment: failure for failure in found}
