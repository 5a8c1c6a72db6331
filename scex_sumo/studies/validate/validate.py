"""Validate a mix of models on recordings, from datasets to the folder with tables and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import TrackError
from scex_sumo.base.files import replacing
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.converters.datasets.find import find_recordings, left_out
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.run import MomentWorkers
from scex_sumo.studies.moments.study import MomentRun
from scex_sumo.studies.validate.moment import ALL, ForecastFolder, ValidationSettings, validate_moment
from scex_sumo.studies.validate.page import write_validation_page
from scex_sumo.studies.validate.scoring import (
    event_scores,
    gathered,
    pair_scores,
    position_scores,
    summary,
    value_scores,
    verdicts,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """A finished validation.

    Attributes:
        info: content of ``validate.json``.
        tables: events, pairs, values and positions, as in the folder.

    Example:
        >>> out = scex.validate(scex.example_path("roundabout"), out="validated", every=9, futures=4)
        >>> out.folder.name
        'validated'
    """

    folder: Path
    info: Mapping[str, Any]
    tables: Mapping[str, pa.Table]


@checked
def validate(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    models: str = "likely",
    futures: int = 96,
    every: float = 1.0,
    part: str = ALL,
    steps: int = 30,
    seed: int = 0,
    workers: int = 1,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | bool | None = None,
) -> Validation:
    """Run moments of recordings with a mix of models, and score its forecasts against what happened.

    Args:
        roots: folders of recordings, or single files.
        out: folder of the validation; an interrupted one goes on.
        every: as of `scex_sumo.studies.validate.moment.ValidationSettings`, like ``part``.
        steps: of 0.1 s of each future.
        workers: processes.
        overwrite: replace another validation in ``out``.
        command: the command line, for ``validate.json``.
        progress: True for a bar; or called with (moments done, moments known).

    Raises:
        UsageError: an argument makes no sense.
        TrackError: no moment can be judged.
        ResultError: the folder cannot be written or holds something else.

    Example:
        >>> out = scex.validate(scex.example_path("roundabout"), out="validation", every=9, futures=4)
        >>> sorted(out.tables)
        ['events', 'pairs', 'positions', 'values']
    """
    settings = ValidationSettings(
        run=RunSettings(models=models, futures=futures, steps=steps, seed=seed), every=every, part=part
    )
    places = [roots] if isinstance(roots, str | Path) else roots
    recordings = find_recordings(places)
    identity = settings.to_json(recordings)
    with (
        MomentWorkers(workers) as pool,
        ForecastFolder(Path(out), identity, overwrite=overwrite) as folder,
        progress_of(progress, "validate") as tick,
    ):
        study = MomentRun(recordings, settings, folder, pool, tick)
        study.run(validate_moment, settings.moments)
        failures = study.unreadable | study.failures
        scored = [(ref, folder.read(ref)) for ref in study.refs]
        if not scored:
            reason = next((failure.reason for failure in failures.values()), f"part {part} has no moments")
            raise TrackError(f"no moment of {len(recordings)} recordings can be judged: {reason}")
        forecasts = gathered(scored)
        rows = {
            "events": event_scores(forecasts),
            "pairs": pair_scores(forecasts),
            "values": value_scores(forecasts),
            "positions": position_scores(forecasts),
        }
        tables = {name: pa.Table.from_pylist(part_rows) for name, part_rows in rows.items()}
        for name, table in tables.items():
            with replacing(folder.path / f"{name}.parquet") as file:
                pq.write_table(table, file)
        figures = summary(forecasts, rows["events"])
        info = {
            **identity,
            **figures,
            "failed": {name: failure.reason for name, failure in failures.items()},
            "notes": [*left_out(places), *pool.deaths, *verdicts(figures)],
        }
        write_validation_page(folder.path, info, rows)
        info = folder.finished(info, command)
    return Validation(folder=Path(out), info=info, tables=tables)
