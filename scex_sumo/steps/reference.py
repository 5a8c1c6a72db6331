"""Human-like reference of a run: the same moment with drivers as people were recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.progress import Progress
from scex_sumo.extrapolation.engine import run_scene, simulate_ahead
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions, no_bar
from scex_sumo.extrapolation.processes.pool import succeeded
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.info import REFERENCE
from scex_sumo.world.base import WORLDS

REFERENCE_FUTURES: Final = 32
"""With more, P of the most probable pair varies as much from seed to seed."""
LEAST_FUTURES: Final = 16
"""A reference of 3 s has as many at least, however few the run has; so has a moment in ``rank``."""
_LEAST_STEPS: Final = 30 * LEAST_FUTURES

_ENOUGH: Final = ".enough"
"""File by which a run asks the worker that simulates its reference to leave the rest to all."""


def reference_ahead(job: Job, models: str, workers: Workers, options: RunOptions) -> Future[Any] | None:
    """Simulate the reference of a run in a worker that is free meanwhile; None without one."""
    wanted = reference_settings(job.settings, models, len(job.assignment))
    these = job.scene, wanted, ModelSet.of(wanted), _options(options, job.folder, no_bar)
    enough = job.folder / _ENOUGH
    enough.unlink(missing_ok=True)
    ahead = partial(simulate_ahead, *these, enough=enough)
    return workers.submit(ahead, where="in the reference", waits=True)


def run_reference(
    job: Job,
    models: str,
    workers: Workers,
    options: RunOptions,
    ahead: Future[Any] | None,
    extras: Sequence[Extra],
) -> None:
    """Run the reference, or what `reference_ahead` left of it, with all workers; a finished one is kept."""
    if ahead is not None:
        enough = job.folder / _ENOUGH
        enough.touch()
        try:
            succeeded(ahead)
        finally:
            enough.unlink()
    own = _options(options, job.folder, lambda label: options.bar("human-like futures"))
    wanted = reference_settings(job.settings, models, len(job.assignment))
    run_scene(job.scene, wanted, workers=workers, options=own, extras=extras)


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

    At most as many as the run has, but at least `LEAST_FUTURES` of 3 s, or others of that cost.
    """
    return min(REFERENCE_FUTURES, max(futures, _LEAST_STEPS // steps))
