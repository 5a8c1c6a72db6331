"""Driving functions under test as an extra of a run: the same futures without them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from scex_sumo.base.options import option
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.extras import Extra, Work
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import Row
from scex_sumo.results.run import BASELINE, UNDER_TEST, Run

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True, kw_only=True)
class Baseline(Extra):
    """Every future again, with the vehicles under test driven as drawn, in the folder ``baseline/``."""

    order: ClassVar[int] = 5
    files: ClassVar[tuple[str, ...]] = (BASELINE, UNDER_TEST)

    baseline: bool = option("Run the futures without the models under test, too.", True)

    def repeats(self, settings: RunSettings) -> int:
        """Return 1 if a driving function is under test."""
        return int(self.baseline and any(model is not None for model in settings.under_test.values()))

    def after(self, work: Work) -> Sequence[Row]:
        """Run the baseline."""
        job = work.job
        if self.repeats(job.settings):
            settings = dataclasses.replace(
                job.settings,
                futures="all" if job.settings.count is None else len(job.assignment),
                under_test=dict.fromkeys(job.settings.under_test),
                until_band=None,
            )
            options = dataclasses.replace(
                work.options, gui=False, out=job.folder / BASELINE, overwrite=True, bar=work.bar_of_repeat
            )
            run_scene(job.scene, settings, workers=work.workers, options=options)
        return ()

    def print_above(self, run: Run, console: Console, preset: str | None) -> None:
        """Print the verdict, the vehicle's own encounters, and the comparison with the baseline."""
        if run.baseline is not None and run.info.get("under_test"):
            from scex_sumo.studies.under_test.table import print_under_test

            print_under_test(run, console, preset=preset)

    def page(self, run: Run) -> Any:
        """Return the card of the driver under test; None without a baseline."""
        if run.baseline is None or not run.info.get("under_test"):
            return None
        from scex_sumo.studies.under_test.page import under_test_part

        return under_test_part(run)
