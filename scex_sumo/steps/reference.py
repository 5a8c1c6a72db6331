"""Human-like reference of a run: the same moment with drivers as people were recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.progress import Progress
from scex_sumo.drivers.registry import parse_models
from scex_sumo.extrapolation.engine import run_scene, simulate_ahead
from scex_sumo.extrapolation.extras import Work
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions, no_bar
from scex_sumo.extrapolation.processes.pool import succeeded
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import REFERENCE
from scex_sumo.results.run import Run
from scex_sumo.steps.reference_options import HumanReference
from scex_sumo.world.base import WORLDS

REFERENCE_FUTURES: Final = 64
"""A share then has a 95 % interval of at most +-12 %."""
REFERENCE_STEPS: Final = 30
"""Up to so many steps, a reference has all `REFERENCE_FUTURES`, however few the run has."""


_ENOUGH: Final = ".enough"
"""File by which a run asks the worker that simulates its reference to leave the rest to all."""


class ReferenceExtra(HumanReference):
    """Human-like reference with its methods."""

    def check(self, settings: RunSettings, models: ModelSet) -> None:
        """Raise a `UsageError` for unknown models."""
        parse_models(str(self.reference))

    def begin(self, job: Job, workers: Workers, options: RunOptions) -> Future[Any] | None:
        """Simulate the reference in a worker."""
        wanted = reference_settings(job.settings, str(self.reference), len(job.assignment))
        these = job.scene, wanted, ModelSet.of(wanted), _options(options, job.folder, no_bar)
        enough = job.folder / _ENOUGH
        enough.unlink(missing_ok=True)
        ahead = partial(simulate_ahead, *these, enough=enough)
        return workers.submit(ahead, where="in the reference", waits=True)

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Run the reference, or what `begin` left of it, with all workers; a finished one is kept."""
        job, workers = work.job, work.workers
        if work.begun is not None:
            enough = run.folder / _ENOUGH
            enough.touch()
            try:
                succeeded(work.begun)
            finally:
                enough.unlink()
        options = _options(work.options, run.folder, lambda label: work.options.bar("human-like futures"))
        others = [extra for extra in work.extras if extra.nested and not isinstance(extra, HumanReference)]
        wanted = reference_settings(job.settings, str(self.reference), run.futures)
        run_scene(job.scene, wanted, workers=workers, options=options, extras=others)
        return {}


def _options(
    options: RunOptions, folder: Path, bar: Callable[[str], AbstractContextManager[Progress | None]]
) -> RunOptions:
    """Return the options of the reference of a run in a folder."""
    return dataclasses.replace(
        options,
        out=folder / REFERENCE,
        bar=bar,
        gui=False,
        extra=(),
        overwrite=True,
        is_reference=True,
    )


def reference_settings(settings: RunSettings, models: str, futures: int) -> RunSettings:
    """Return the settings of the reference of a run with this number of futures."""
    return dataclasses.replace(
        settings,
        models=models,
        assign={},
        under_test={},
        futures=reference_futures(futures, settings.steps),
        world="checked" if WORLDS.load(settings.world).has_sumo else "plain",
    )


def reference_futures(futures: int, steps: int) -> int:
    """Return the number of futures of the reference of a run.

    There are fewer than `REFERENCE_FUTURES` if they would cost more than the run and than `REFERENCE_STEPS`
    steps of all.
    """
    return min(REFERENCE_FUTURES, max(futures, REFERENCE_FUTURES * REFERENCE_STEPS // steps))
