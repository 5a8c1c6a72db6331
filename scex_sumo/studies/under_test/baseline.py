"""Baseline of a run with a driving function under test: the same futures without it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.extras import Work
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import BASELINE, Row
from scex_sumo.results.run import Run
from scex_sumo.studies.under_test.extra import Baseline
from scex_sumo.studies.under_test.page import under_test_part
from scex_sumo.studies.under_test.table import print_under_test


class BaselineExtra(Baseline):
    """Baseline with its methods."""

    def repeats(self, settings: RunSettings) -> int:
        """Return 1."""
        return 1

    def after(self, work: Work) -> Sequence[Row]:
        """Run the baseline."""
        job = work.job
        settings = dataclasses.replace(
            job.settings,
            futures="all" if job.settings.count is None else len(job.assignment),
            under_test=dict.fromkeys(job.settings.under_test),
        )
        options = dataclasses.replace(
            work.options, gui=False, out=job.folder / BASELINE, overwrite=True, bar=work.bar_of_repeat
        )
        run_scene(job.scene, settings, workers=work.workers, options=options)
        return ()

    def print_above(self, run: Run, console: Console, every: bool) -> None:
        """Print the verdict, the vehicle's own encounters, and the comparison with the baseline."""
        if run.info.get("under_test"):
            print_under_test(run, console, every=every)

    def page(self, run: Run) -> Any:
        """Return the card of the driver under test."""
        return under_test_part(run) if run.info.get("under_test") else None
