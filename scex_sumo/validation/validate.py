"""Validation of a mix of models on recordings: from datasets to the folder with tables and page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.behaviors.models.population import population_digest
from scex_sumo.converters.datasets.recordings import (
    LoadedRecording,
    Recording,
    find_recordings,
    recording_moments,
)
from scex_sumo.converters.moments.moments import Moment
from scex_sumo.errors import TrackError, UsageError
from scex_sumo.files import replacing
from scex_sumo.ranking.moments import Failure, Listing, MomentRef
from scex_sumo.ranking.run_moment import MomentTask
from scex_sumo.ranking.settings import RankSettings
from scex_sumo.ranking.tasks import moment_tasks, read_ahead
from scex_sumo.ranking.workers import DaskWorkers, LocalWorkers, MomentWorkers
from scex_sumo.results.provenance import versions
from scex_sumo.scene import STEP_S
from scex_sumo.training.data.split import PARTS, Split, split_moments
from scex_sumo.validation.folder import INFO, ForecastFolder
from scex_sumo.validation.moment import ForecastTask, validate_moment
from scex_sumo.validation.noise import BoxNoise, box_noise
from scex_sumo.validation.page import write_validation_page
from scex_sumo.validation.scoring import (
    encounter_scores,
    event_scores,
    gathered,
    position_scores,
    summary,
    value_scores,
)
from scex_sumo.version import __version__

_AHEAD = 4  # seed scenes built before a worker asks for them
ALL = "all"


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """A finished validation.

    Attributes:
        folder: where it is.
        info: what ``validate.json`` says.
        tables: by name (events, values, positions), as in the folder.
    """

    folder: Path
    info: Mapping[str, Any]
    tables: Mapping[str, pa.Table]


def validate(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    models: str = "likely",
    children: int = 96,
    every: float = 1.0,
    min_vehicles: int = 2,
    part: str = ALL,
    seed: int = 0,
    workers: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Any = None,
) -> Validation:
    """Run moments of recordings with a mix of models, and score its forecasts against what happened.

    Args:
        roots: folders of recordings, or single files.
        out: folder of the validation; an interrupted one goes on.
        models: the mix.
        children: of each moment.
        every: least time between two moments of a recording, s.
        min_vehicles: fewer moving vehicles make no moment.
        part: ``train``, ``validation`` or ``test`` of each recording's time, as learned drivers are trained,
            or ``all``.
        seed: random seed.
        workers: processes of this machine.
        cluster: address of a Dask scheduler, whose workers are used instead.
        overwrite: replace another validation in ``out``, or the same one once it is finished.
        command: the command line, for ``validate.json``.
        progress: called with (moments done, moments known).

    Raises:
        UsageError: an argument that makes no sense.
        TrackError: no recordings, or no moment in them that can be judged.
        ResultError: the folder cannot be written or holds something else.
    """
    if part not in (*PARTS, ALL):
        raise UsageError(f"--part {part}: unknown; choose {', '.join(PARTS)} or {ALL}")
    started = time.perf_counter()
    settings = RankSettings(
        models=(models,), children=children, first=children, every=every, min_vehicles=min_vehicles, seed=seed
    )
    recordings = find_recordings([roots] if isinstance(roots, str | Path) else roots)
    identity = {**settings.to_json(recordings), "part": part, "population": population_digest()}
    again = overwrite and (Path(out) / INFO).is_file()  # an interrupted one goes on
    at_work: MomentWorkers = (
        LocalWorkers(workers, validate_moment) if cluster is None else DaskWorkers(cluster, validate_moment)
    )
    with closing(at_work), ForecastFolder(Path(out), identity, overwrite=overwrite) as folder:
        if again:
            folder.restart()
        refs = _run(recordings, settings, part, folder, at_work, progress)
        failures = folder.failures()
        found = [(ref, folder.read(ref)) for ref in refs if folder.has(ref)]
        if not found:
            reason = next((failure.reason for failure in failures.values()), f"part {part} has no moments")
            raise TrackError(f"no moment of {len(recordings)} recordings can be judged: {reason}")
        forecasts = gathered(found)
        rows = {
            "events": event_scores(forecasts),
            "values": [*value_scores(forecasts, seed=seed), *encounter_scores(forecasts)],
            "positions": position_scores(forecasts),
        }
        tables = {name: pa.Table.from_pylist(part_rows) for name, part_rows in rows.items()}
        for name, table in tables.items():
            with replacing(folder.path / f"{name}.parquet") as file:
                pq.write_table(table, file)
        info = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            **identity,
            **summary(forecasts, rows["events"]),
            "failed": {name: failure.reason for name, failure in failures.items()},
            "notes": at_work.notes(),
            "versions": versions(),
            "seconds": round(time.perf_counter() - started, 1),
        }
        write_validation_page(folder.path, info, rows)
        folder.finish(info)
    return Validation(folder=Path(out), info=info, tables=tables)


def _run(
    recordings: Sequence[Recording],
    settings: RankSettings,
    part: str,
    folder: ForecastFolder,
    workers: MomentWorkers,
    progress: Any,
) -> list[MomentRef]:
    """Run what is left to run; all moments."""
    refs: list[MomentRef] = []
    noise: dict[str, BoxNoise] = {}
    done = 0

    def tasks(items: Iterator[Listing | Failure | MomentTask]) -> Iterator[ForecastTask]:
        for item in items:
            if isinstance(item, MomentTask):
                yield ForecastTask.of(item, noise[item.ref.recording])
            elif isinstance(item, Failure):
                folder.fail(item)
            else:
                refs.extend(item.moments)

    def left(listing: Listing) -> list[MomentRef]:
        failed = folder.failures()
        return [ref for ref in listing.moments if not folder.has(ref) and ref.moment not in failed]

    def chosen(loaded: LoadedRecording) -> Sequence[Moment]:
        rows, split = loaded.table.vehicles, Split()
        known = len(rows) and rows.stamps_ms[0] + (1 - split.validation - split.test) * np.ptp(rows.stamps_ms)
        noise[loaded.recording.name] = box_noise(rows, float(known) / 1000)
        return _of_part(loaded, part, settings.every)

    cut = moment_tasks(
        recordings,
        {},
        settings,
        range(settings.children),
        wanted=left,
        spare=lambda ref: 0,
        choose=chosen,
    )
    items = read_ahead(cut, _AHEAD)
    try:
        for task, found in workers.run(tasks(items)):
            if isinstance(found, Failure):
                folder.fail(found)
            else:
                folder.append(task.ref, found)
            done += 1
            if progress is not None:
                progress(done, max(len(refs), done))
    finally:
        items.close()
    return refs


def _of_part(loaded: LoadedRecording, part: str, every: float) -> Sequence[Moment]:
    """The moments of a part of a recording, at least ``every`` seconds apart."""
    found = recording_moments(loaded, every_s=STEP_S)
    if part != ALL:
        found = split_moments(found, Split())[part]  # type: ignore[index]
    else:  # from the first that can be judged on: a recording shorter than ``every`` has one, too
        found = [moment for moment in found if moment.case or moment.complete]
    moments: list[Moment] = []
    for moment in found:
        if not moments or moment.case or moment.time_s >= moments[-1].time_s + every - 1e-6:
            moments.append(moment)
    return moments
