"""Study settings: the values that identify a study of many moments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.metrics.registry import describe_metrics, thresholds_of


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """Settings that all studies of moments share.

    Attributes:
        run: of each moment; SUMO checks samples of its children.
        every: least time between two moments of a recording, s; every case is a moment.
        min_vehicles: least number of moving vehicles.
        cache: use converted nets in ``~/.cache/scex-sumo``.
        weights: SHA-256 of the weights by learned model.
    """

    run: RunSettings = field(default_factory=lambda: RunSettings(children=96))
    every: float = 1.0
    min_vehicles: int = 2
    cache: bool = True
    weights: Mapping[str, str] = field(init=False)

    def __post_init__(self) -> None:
        if not self.every > 0:
            raise UsageError(f"--every: got {self.every:g}, needs seconds above 0")
        self.check_positive("min_vehicles")
        run = self.run
        if run.count is None or run.until_band is not None or run.assign or run.under_test:
            raise UsageError(
                "a study draws the models of all vehicles in a fixed number of children; "
                "leave out children='all', until_band, assign and under_test"
            )
        models = written(run.models)
        run = dataclasses.replace(run, models=models, keep_plans=False, world="checked")
        object.__setattr__(self, "run", run)
        object.__setattr__(self, "weights", built(models).weights)

    def check_positive(self, name: str) -> None:
        """Raise a `UsageError` for a number below 1."""
        if getattr(self, name) < 1:
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: got {getattr(self, name)}, needs at least 1")

    @property
    def children(self) -> int:
        """Maximum number of children of a moment."""
        assert self.run.count is not None
        return self.run.count

    @property
    def models(self) -> tuple[str, ...]:
        """Models as on the command line."""
        models = self.run.models
        assert isinstance(models, tuple)
        return models

    @cached_property
    def thresholds(self) -> Mapping[str, float]:
        """Thresholds by metric column, in the order of the columns."""
        limits = {**thresholds_of(self.run.measured), **self.run.thresholds}
        return {column: limits[column] for column in self.run.columns if column in limits}

    def identity(self, recordings: Sequence[Recording], *, first: int, top: int, keep: str) -> dict[str, Any]:
        """Return the values that identify a study; name and size stand for a recording."""
        run, described = self.run, describe_metrics(self.run.measured)
        return {
            "recordings": [_described(recording) for recording in recordings],
            "every_s": self.every,
            "min_vehicles": self.min_vehicles,
            "first": first,
            "children": self.children,
            "top": top,
            "models": list(self.models),
            "weights": dict(self.weights),
            "steps": run.steps,
            "replan": run.replan,
            "design": run.design,
            "preset": run.preset,
            **({"metrics": described} if described else {}),
            "seed": run.seed,
            "thresholds": dict(self.thresholds),
            "keep": keep,
            "version": __version__,
        }


def _described(recording: Recording) -> dict[str, Any]:
    files = (recording.map_path, *recording.track_paths)
    sizes = [file.stat().st_size if file.exists() else None for file in files]
    window = {"window_s": list(recording.window)} if recording.window != (None, None) else {}
    return {"name": recording.name, "site": recording.site, "bytes": sizes} | window


def written(models: Models) -> tuple[str, ...]:
    """Return models to draw from as on the command line."""
    drawn = ModelSet.of(RunSettings(models=models)).drawn
    return tuple(f"{spec}@{spec.weight!r}" if spec.weight != 1 else str(spec) for spec in drawn)


@lru_cache(maxsize=4)
def built(models: tuple[str, ...]) -> ModelSet:
    """Build models, once in a process."""
    return ModelSet.of(RunSettings(models=models))
