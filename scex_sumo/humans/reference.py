"""Human-like reference of a run: the same moment with drivers as people were recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from scex_sumo.behaviors.registry import parse_models
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.extras import Work
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.humans.extra import HumanReference
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.world.base import WORLDS

REFERENCE_FUTURES: Final = 117
"""A share then has a 95 % interval of at most +-9 %."""
REFERENCE_STEPS: Final = 30
"""Up to so many steps, a reference has all `REFERENCE_FUTURES`, however few the run has."""


class ReferenceExtra(HumanReference):
    """Human-like reference with its methods."""

    def check(self, settings: RunSettings, models: ModelSet) -> None:
        """Raise a `UsageError` for unknown models."""
        parse_models(str(self.reference))

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Run the reference; a finished one is kept."""
        job, workers = work.job, work.workers
        options = dataclasses.replace(
            work.options,
            batch=None,
            gui=False,
            overwrite=True,
            is_reference=True,
            out=run.folder / REFERENCE,
            bar=lambda label: work.options.bar("reference"),
        )
        others = [extra for extra in work.extras if extra.nested and not isinstance(extra, HumanReference)]
        wanted = reference_settings(job.settings, str(self.reference), run.futures)
        run_scene(job.scene, wanted, workers=workers, options=options, extras=others)
        return {}


def reference_settings(settings: RunSettings, models: str, futures: int) -> RunSettings:
    """Return the settings of the reference of a run with this number of futures."""
    return dataclasses.replace(
        settings,
        models=models,
        assign={},
        under_test={},
        futures=reference_futures(futures, settings.steps),
        design=RunSettings.design,
        until_band=None,
        keep_plans=False,
        world="checked" if WORLDS.load(settings.world).has_sumo else "plain",
    )


def reference_futures(futures: int, steps: int) -> int:
    """Return the number of futures of the reference of a run.

    There are fewer than `REFERENCE_FUTURES` if they would cost more than the run and than `REFERENCE_STEPS`
    steps of all.
    """
    return min(REFERENCE_FUTURES, max(futures, REFERENCE_FUTURES * REFERENCE_STEPS // steps))
