"""Ranking settings: all that decides on the values of a ranking, checked where they are made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.registry import describe_metrics, thresholds_of
from scex_sumo.results.design import design_intervals
from scex_sumo.statistics.designs import DEFAULT_DESIGN
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.version import __version__

KEEP = ("none", "critical", "all")


@dataclass(frozen=True, kw_only=True)
class RankSettings:
    """Settings of a ranking.

    Attributes:
        every: least time between two moments of a recording, s; of a file of cases every case is a moment.
        min_vehicles: fewer moving vehicles make no moment.
        first: children that every moment gets.
        children: children of a moment at most.
        top: moments on the page, and those whose places are made sure of.
        models: behaviour models to draw from, in any form that `extrapolate` takes; kept as on the command
            line.
        weights: SHA-256 of the weights by learned model, found here.
        steps: steps of 0.1 s per child.
        replan: steps that a plan is followed.
        design: how assignments are drawn; fewer children must be the first of more.
        preset: which metrics are evaluated, as of a run.
        metrics: in their place, as of a run.
        seed: the same seed gives the same ranking.
        thresholds: by metric column, on top of the defaults; kept whole, in the order of the columns.
        cache: take converted nets from ``~/.cache/scex-sumo`` and keep them there.
        keep: whose tracks are kept: ``none``, ``critical`` (at most 5 of a moment) or ``all``.
        run: of each moment, from the above.

    Raises:
        UsageError: one that makes no sense.
    """

    every: float = 1.0
    min_vehicles: int = 2
    first: int = 32
    children: int = 96
    top: int = 10
    models: tuple[str, ...] = (DEFAULT_MODELS,)
    weights: Mapping[str, str] = field(init=False)
    steps: int = 30
    replan: int = 5
    design: str = field(init=False, default=DEFAULT_DESIGN)
    preset: str = "both"
    metrics: Sequence[str | Metric] | None = None
    seed: int = 0
    thresholds: Mapping[str, float] = field(default_factory=dict)
    keep: str = "none"
    cache: bool = True
    run: RunSettings = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._check()
        models = written(self.models)
        run = RunSettings(
            models=models,
            children=self.children,
            design=self.design,
            preset=self.preset,
            metrics=self.metrics,
            steps=self.steps,
            replan=self.replan,
            seed=self.seed,
            thresholds=self.thresholds,
            keep_plans=False,
            world="checked",
        )
        limits = {**thresholds_of(run.measured), **run.thresholds}
        settled = {
            "run": run,
            "first": min(self.first, self.children),
            "models": models,
            "weights": built(models).weights,
            "thresholds": {column: limits[column] for column in run.columns if column in limits},
        }
        for name, value in settled.items():
            object.__setattr__(self, name, value)

    def _check(self) -> None:
        if not self.every > 0:
            raise UsageError(f"--every: got {self.every:g}, needs seconds above 0")
        for name in ("first", "min_vehicles", "top"):
            if getattr(self, name) < 1:
                option = name.replace("_", "-")
                raise UsageError(f"--{option}: got {getattr(self, name)}, needs at least 1")
        if self.keep not in KEEP:
            raise UsageError(f"--keep: got {self.keep!r}; known: {', '.join(KEEP)}")

    def to_json(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Identity of the ranking of some recordings, which may lie anywhere: name and size tell them."""
        return {
            "recordings": [_described(recording) for recording in recordings],
            "every_s": self.every,
            "min_vehicles": self.min_vehicles,
            "first": self.first,
            "children": self.children,
            "top": self.top,
            "models": list(self.models),
            "weights": dict(self.weights),
            "steps": self.steps,
            "replan": self.replan,
            "design": self.design,
            "preset": self.preset,
            **({"metrics": described} if (described := describe_metrics(self.run.measured)) else {}),
            "seed": self.seed,
            "thresholds": dict(self.thresholds),
            "keep": self.keep,
            "version": __version__,
        }

    def intervals(self, models: Sequence[Sequence[str]]) -> DesignIntervals:
        """Intervals over children with these models, one for each vehicle."""
        drawn = built(self.models).drawn
        place = {str(spec): index for index, spec in enumerate(drawn)}
        levels = np.array([[place[name] for name in row] for row in models], dtype=np.int64)
        always = np.zeros(levels.shape[1], dtype=np.bool_)
        return design_intervals(levels, [spec.weight for spec in drawn], always, self.design)


def _described(recording: Recording) -> dict[str, Any]:
    files = (recording.map_path, *recording.track_paths)
    sizes = [file.stat().st_size if file.exists() else None for file in files]
    return {"name": recording.name, "site": recording.site, "bytes": sizes}


def written(models: Models) -> tuple[str, ...]:
    """Models to draw from as on the command line."""
    drawn = ModelSet.of(RunSettings(models=models)).drawn
    return tuple(f"{spec}@{spec.weight!r}" if spec.weight != 1 else str(spec) for spec in drawn)


@lru_cache(maxsize=4)
def built(models: tuple[str, ...]) -> ModelSet:
    """Models made, once in a process."""
    return ModelSet.of(RunSettings(models=models))
