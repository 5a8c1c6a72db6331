"""Forecast of a moment in a worker, measured as what really happened is; settings and folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError, UsageError
from scex_sumo.base.files import sha256_of
from scex_sumo.converters.datasets.moment import Moment
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, recording_moments
from scex_sumo.evaluation.split import PARTS, Split, split_moments
from scex_sumo.extrapolation.job import ruled, run_in_memory
from scex_sumo.extrapolation.loop.measure import measure_recorded, recorded_steps_of
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.humans.parameters import SHIPPED
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.results.folder import values_table
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.results.tables.outcomes import collided
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.studies.moments.folder import MomentRef, StudyFolder
from scex_sumo.studies.moments.run import MomentTask, StudySettings, built, net_of
from scex_sumo.studies.validate.vehicles import ENCOUNTERS, POSITIONS, pair_forecasts, position_forecasts

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class ValidationSettings(StudySettings):
    """Settings of a validation; a part of each recording's time is that of learned drivers, or ``all``."""

    part: str = ALL

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.part not in (*PARTS, ALL):
            raise UsageError(f"--part {self.part}: unknown; choose {', '.join(PARTS)} or {ALL}")

    def to_json(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Return the values that identify the validation of some recordings."""
        columns = [*POSITIONS.names, *ENCOUNTERS.names]  # moments of other tables cannot be joined
        return {
            **self.identity(recordings),
            "part": self.part,
            "population": sha256_of(SHIPPED),
            "columns": columns,
        }

    def moments(self, loaded: LoadedRecording) -> Sequence[Moment]:
        """Return the moments of the part of a recording, at least ``every`` seconds apart."""
        candidates = recording_moments(loaded, every_s=STEP_S)
        if self.part != ALL:
            candidates = split_moments(candidates, Split())[self.part]  # type: ignore[index]
        else:  # from the first that can be judged on: a recording shorter than ``every`` has one, too
            candidates = [moment for moment in candidates if moment.case or moment.complete]
        last_s = loaded.table.vehicles.stamps_ms[-1] / 1000 - STEP_S * self.run.steps if candidates else 0.0
        moments: list[Moment] = []
        for moment in candidates:
            if not moment.case and self.run.steps > FIRST_STEPS and moment.time_s > last_s + 1e-6:
                continue  # nobody is recorded to the end of so long futures
            if not moments or moment.case or moment.time_s >= moments[-1].time_s + self.every - 1e-6:
                moments.append(moment)
        return moments


FIRST_STEPS = 30  # that vehicles of all moments are recorded for
RECORDED, CONSTANT_VELOCITY = -1, -2
"""Rows beside the futures: what happened, constant velocity."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """Forecast of a moment, and what happened: see `position_forecasts`, `pair_forecasts`.

    Rows of ``futures``: metric columns and ``collision`` of each future, and of the two rows beside them.
    """

    vehicles: pa.Table
    encounters: pa.Table
    futures: pa.Table


def validate_moment(task: MomentTask, scene: SeedScene) -> Forecast:
    """Run the futures of a task."""
    run = task.settings.run
    steps = run.steps
    valid = scene.future_valid
    judged = np.zeros(0, dtype=bool) if valid is None else np.all(valid[:, :steps], axis=1)
    if valid is None or valid.shape[1] < steps or not judged.any():
        raise TrackError(f"no vehicle is recorded for {steps} steps after the moment; choose another moment")
    plain = RunSettings(models="constant_velocity", futures=1, steps=steps, world=run.world)
    # Vehicles leave the futures at the step at which they leave the recording.
    net, count = net_of(task.road), task.settings.futures
    futures = _run(scene, net, run, built(task.settings.models))
    straight = _run(scene, net, plain, ModelSet.of(plain))
    recorded = measure_recorded(scene, steps, metrics=run.measured)
    assert recorded is not None
    happened = np.where(recorded.values.defined, recorded.values.values, np.nan)
    rows = [
        (np.arange(count), _values(futures), collided(futures.collisions, futures.futures)),
        (np.array([RECORDED]), happened, np.array([len(recorded.overlaps) > 0])),
        (np.array([CONSTANT_VELOCITY]), _values(straight), collided(straight.collisions, straight.futures)),
    ]
    return Forecast(
        futures=_futures_table(run.columns, rows),
        vehicles=position_forecasts(scene, futures.states, straight.states, judged),
        encounters=pair_forecasts(
            scene, _encounters(futures), _encounters(straight), recorded.encounters, judged, futures=count
        ),
    )


def _run(scene: SeedScene, net: SumoNet, settings: RunSettings, models: ModelSet) -> Part:
    models.try_on(scene, seed=settings.seed)
    scene, net = ruled(scene, net, settings)
    return run_in_memory(scene, net, settings, models, counted=recorded_steps_of(scene, settings.steps))


def _values(futures: Part) -> FloatArray:
    return np.where(futures.defined, futures.values, np.nan)


def _encounters(futures: Part) -> Encounters:
    assert futures.encounters is not None
    return rows_in(Encounters, futures.encounters)


def _futures_table(columns: tuple[str, ...], rows: list[tuple[IntArray, FloatArray, BoolArray]]) -> pa.Table:
    futures, values, hit = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    return values_table(columns, values, ~np.isnan(values), futures).append_column("collision", pa.array(hit))


class ForecastFolder(StudyFolder):
    """Folder of the forecasts of moments: ``moments/NAME/futures.parquet`` and two more tables."""

    info, what, another, place = "validate.json", "validation", "another validation", "moments/{ref.moment}"
    evidence = ("events.parquet", "pairs.parquet", "values.parquet", "positions.parquet", "moments")
    kept = ("encounters.parquet",)

    def _tables(self, result: Forecast) -> Mapping[str, pa.Table]:
        return vars(result)

    def read(self, ref: MomentRef) -> Forecast:
        """Read the forecast of a moment."""
        names = (table.name for table in dataclasses.fields(Forecast))
        return Forecast(**{name: self._read(ref, name) for name in names})
