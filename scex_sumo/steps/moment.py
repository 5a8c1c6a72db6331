"""Run of a moment: its futures, and the steps that follow them."""

from __future__ import annotations

import dataclasses
from typing import Final

from scex_sumo.extrapolation.engine import checked_models, run_scene
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.decision import DECISION
from scex_sumo.results.info import BASELINE, PAGE, REFERENCE
from scex_sumo.results.run import Run
from scex_sumo.results.tables.pairs import PAIRS_FILE
from scex_sumo.scene import SeedScene

REFERENCE_FUTURES: Final = 32
"""With more, P of the most probable pair varies as much from seed to seed."""
LEAST_FUTURES: Final = 16
"""A reference of 3 s has as many at least, however few the run has; so has a moment in ``rank``."""
_LEAST_STEPS: Final = 30 * LEAST_FUTURES


def run_moment(
    scene: SeedScene,
    settings: RunSettings,
    *,
    workers: Workers,
    options: RunOptions,
    models: ModelSet | None = None,
) -> Run:
    """Simulate and measure the futures of a seed scene that has a road; then take the steps below.

    Args:
        models: what `checked_models` returned for these settings; None builds them.

    Raises:
        ScexError: as of `extrapolate`.
    """
    if (numbered := settings.numbered(scene)) is not settings:
        settings, models = numbered, None
    human, models = options.human, models or checked_models(settings, options)
    is_tested = any(model is not None for model in settings.under_test.values())
    off = [] if is_tested else [BASELINE]
    off += [] if human is not None else [REFERENCE, PAIRS_FILE, DECISION]
    off += [] if options.report else [PAGE]
    run, job = run_scene(scene, settings, workers=workers, options=options, models=models, stale=off)
    if is_tested:
        _run_baseline(job, workers, options)
    if human is not None:
        from scex_sumo.decision.of_run import decide_run

        _run_reference(job, human, workers, options)
        decide_run(run, job.scene)
    if options.report:
        from scex_sumo.page.report.report import write_report

        with options.bar("page"):
            run.written["report"] = write_report(run, job.scene)
    return run


def _run_baseline(job: Job, workers: Workers, options: RunOptions) -> None:
    """Run every future again, with the vehicles under test driven as drawn, in the folder ``baseline/``."""
    settings = dataclasses.replace(
        job.settings,
        futures="all" if job.settings.count is None else len(job.assignment),
        under_test=dict.fromkeys(job.settings.under_test),
    )
    own = dataclasses.replace(options, gui=False, out=job.folder / BASELINE, overwrite=True, extra=())
    run_scene(job.scene, settings, workers=workers, options=own, label="baseline futures")


def _run_reference(job: Job, models: str, workers: Workers, options: RunOptions) -> None:
    """Run the reference with all workers; a finished one is kept."""
    folder = job.folder / REFERENCE
    own = dataclasses.replace(options, gui=False, out=folder, overwrite=True, is_reference=True)
    futures = reference_futures(len(job.assignment), job.settings.steps)
    settings = dataclasses.replace(job.settings, models=models, assign={}, under_test={}, futures=futures)
    drivers = ModelSet.of(settings)
    wanted = dataclasses.replace(settings, world=drivers.world)
    label = "human-like futures"
    run_scene(job.scene, wanted, workers=workers, options=own, models=drivers, label=label)


def reference_futures(futures: int, steps: int) -> int:
    """Return the number of futures of the reference of a run.

    At most as many as the run has, but at least `LEAST_FUTURES` of 3 s, or others of that cost.
    """
    return min(REFERENCE_FUTURES, max(futures, _LEAST_STEPS // steps))
