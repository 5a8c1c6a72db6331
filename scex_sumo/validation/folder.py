"""Folder of a validation: moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.errors import ResultError
from scex_sumo.files import lock, replacing, unlock, write_atomic
from scex_sumo.ranking.folder import found_identity
from scex_sumo.ranking.moments import Failure, MomentRef, as_row, from_row
from scex_sumo.validation.moment import Forecast

INFO = "validate.json"
_PENDING = "incomplete.json"
_TABLES = ("vehicles", "encounters", "realism", "children")  # the last one says that all are there
_MOMENTS, _FAILED = "moments", "failed"


class ForecastFolder:
    """Holds the forecasts of the moments that have run: ``moments/NAME/children.parquet`` and three more."""

    def __init__(self, path: Path, configuration: Mapping[str, Any], *, overwrite: bool = False) -> None:
        """Claim a folder.

        Raises:
            ResultError: it holds something else, cannot be written, or another process writes it.
        """
        self.path = path
        text = json.dumps(configuration, sort_keys=True, default=str)
        self.identity = hashlib.sha256(text.encode()).hexdigest()
        try:
            found = found_identity(path, (_PENDING, INFO))
            if found != self.identity and path.is_dir() and any(path.iterdir()):
                if found is None or not overwrite:
                    what = "not empty, and no validation" if found is None else "holds another validation"
                    remedy = "" if found is None else ", or --overwrite to replace it"
                    raise ResultError(f"{path}: {what}; give another folder with -o{remedy}")
                for name in (_MOMENTS, _FAILED):
                    shutil.rmtree(path / name, ignore_errors=True)
            path.mkdir(parents=True, exist_ok=True)
            lock(path)
            write_atomic(path / _PENDING, json.dumps({"identity": self.identity}).encode())
            (path / INFO).unlink(missing_ok=True)
            (path / _FAILED).mkdir(exist_ok=True)
        except OSError as error:
            raise ResultError(f"{path}: cannot write the validation: {error.strerror or error}") from None

    def __enter__(self) -> ForecastFolder:
        return self

    def __exit__(self, *_: object) -> None:
        unlock(self.path)

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

    def finish(self, info: Mapping[str, Any]) -> None:
        """Write ``validate.json``: from now on the folder is a result."""
        text = json.dumps({**info, "identity": self.identity}, indent=2, default=str) + "\n"
        write_atomic(self.path / INFO, text.encode())
        (self.path / _PENDING).unlink(missing_ok=True)
