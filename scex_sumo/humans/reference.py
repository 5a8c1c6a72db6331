"""Human-like reference of a run: the same moment with drivers as people were recorded."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

from scex_sumo.base.options import option
from scex_sumo.behaviors.registry import parse_models
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.extras import Extra, Work
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.world.base import WORLDS

NONE: Final = "none"
REFERENCE_FUTURES: Final = 117
"""A share then has a 95 % interval of at most +-9 %."""
REFERENCE_STEPS: Final = 30
"""Up to so many steps, a reference has all `REFERENCE_FUTURES`, however few the run has."""


@dataclass(frozen=True, kw_only=True)
class HumanReference(Extra):
    """Futures of human-like drivers beside those of a run, in its folder ``reference/``."""

    order: ClassVar[int] = 20
    files: ClassVar[tuple[str, ...]] = (REFERENCE,)

    reference: str | None = option(
        "Human-like reference, run after the stress test.", "likely", metavar="MIX|none", takes=str
    )

    def check(self, settings: RunSettings, models: ModelSet) -> None:
        """Raise a `UsageError` for unknown models."""
        if self.reference not in (None, NONE):
            parse_models(str(self.reference))

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Run the reference; a finished one is kept."""
        if self.reference in (None, NONE):
            shutil.rmtree(run.folder / REFERENCE, ignore_errors=True)
            return {}
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
        others = [extra for extra in work.extras if extra is not self and extra.nested]
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
