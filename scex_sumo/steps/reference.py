"""Human-like reference of a run: the same moment with drivers as people were recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.info import REFERENCE
from scex_sumo.world.base import WORLDS

REFERENCE_FUTURES: Final = 32
"""With more, P of the most probable pair varies as much from seed to seed."""
LEAST_FUTURES: Final = 16
"""A reference of 3 s has as many at least, however few the run has; so has a moment in ``rank``."""
_LEAST_STEPS: Final = 30 * LEAST_FUTURES


def run_reference(
    job: Job, models: str, workers: Workers, options: RunOptions, extras: Sequence[Extra]
) -> None:
    """Run the reference with all workers; a finished one is kept."""
    own = dataclasses.replace(
        options,
        out=job.folder / REFERENCE,
        bar=lambda label: options.bar("human-like futures"),
        gui=False,
        extra=(),
        overwrite=True,
        is_reference=True,
    )
    wanted = reference_settings(job.settings, models, len(job.assignment))
    run_scene(job.scene, wanted, workers=workers, options=own, extras=extras)


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
