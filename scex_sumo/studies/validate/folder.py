"""Validation folder: moments are added whole, never changed, and found again after a crash."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import ResultError
from scex_sumo.studies.moments.folder import MomentRef, StudyFolder, damaged, read_table, write_table
from scex_sumo.studies.validate.moment import COMPARED, Forecast, asked_of, forecast_schemas
from scex_sumo.studies.validate.settings import ValidationSettings

_MOMENTS = "moments"


class ForecastFolder(StudyFolder):
    """Folder of the forecasts of moments: ``moments/NAME/children.parquet`` and four more tables."""

    info, what, another, kept = "validate.json", "validation", "another validation", (_MOMENTS,)
    evidence = ("events.parquet", "pairs.parquet", "values.parquet", "positions.parquet", _MOMENTS)

    def __init__(
        self,
        path: Path,
        identity: Mapping[str, Any],
        settings: ValidationSettings,
        *,
        overwrite: bool = False,
    ) -> None:
        self._schemas = forecast_schemas(settings)
        self._columns = asked_of(settings).columns
        self._children = list(range(settings.children))
        super().__init__(path, identity, overwrite=overwrite)

    def _prepare(self) -> None:
        super()._prepare()
        for folder in (self.path / _MOMENTS).glob("*/"):
            try:
                self._read(folder)
            except ResultError:
                shutil.rmtree(folder)

    def restart(self) -> None:
        """Remove the moments that have run."""
        self._clear()
        self._prepare()

    def has(self, ref: MomentRef) -> bool:
        """Whether a moment has run."""
        return (self.path / _MOMENTS / ref.moment).is_dir()

    def append(self, ref: MomentRef, forecast: Forecast) -> None:
        """Add the forecast of a moment."""
        for name in self._schemas:
            write_table(self.path / _MOMENTS / ref.moment / f"{name}.parquet", getattr(forecast, name))

    def read(self, ref: MomentRef) -> Forecast:
        """Read the forecast of a moment."""
        return self._read(self.path / _MOMENTS / ref.moment)

    def _read(self, folder: Path) -> Forecast:
        tables = {
            name: read_table(folder / f"{name}.parquet", schema, self._columns)
            for name, schema in self._schemas.items()
        }
        for name, more in (("children", COMPARED), ("seen", ())):
            if tables[name]["child"].to_pylist() != [*self._children, *more]:
                raise damaged(folder / f"{name}.parquet", "has other futures than the validation")
        if len(tables["realism"]) != 1:
            raise damaged(folder / "realism.parquet", "needs one row")
        return Forecast(**tables)
