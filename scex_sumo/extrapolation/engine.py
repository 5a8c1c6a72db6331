"""Run of a seed scene, from checked settings to a finished result folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.progress import Progress
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.base import driven_by_sumo
from scex_sumo.converters.registries import signals_of
from scex_sumo.drivers.registry import parse_models
from scex_sumo.extrapolation.job import Job, batch_size, batches_of, ruled
from scex_sumo.extrapolation.loop.measure import measure_recorded
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.writing import outcome_notes, recorded_info, write_tables
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.metrics.registry import thresholds_of
from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.info import digest, versions
from scex_sumo.results.parts import Part, Parts
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from scex_sumo.world.base import WORLDS


def run_scene(
    scene: SeedScene,
    settings: RunSettings,
    *,
    workers: Workers,
    options: RunOptions,
    models: ModelSet | None = None,
    stale: Sequence[str] = (),
    label: str = "stress-test futures",
) -> tuple[Run, Job]:
    """Simulate and measure the futures of a seed scene that has a road, then let its extras work.

    Args:
        models: what `checked_models` returned for these settings; None builds them.
        stale: results of a former run in its folder, which are removed.
        label: of the progress bar.

    Raises:
        ScexError: as of `extrapolate`.
    """
    temporary = TemporaryFolder() if options.out is None else None
    path = Path(temporary.name) / "run" if temporary else Path(str(options.out))
    folder, job = _folder_and_job(scene, settings, options, models or checked_models(settings, options), path)
    folder.remove(stale)
    # More threads of matrix products would wait for cores on which workers run.
    with threadpool_limits(1, user_api="blas"), options.bar(label) as tick:
        _run_all(job, workers, tick)
        recorded = measure_recorded(
            job.scene,
            settings.steps,
            replan=settings.replan,
            metrics=settings.measured,
            vehicles=settings.vehicles_that_count(job.scene),
        )
        all_futures = write_tables(folder, job, recorded)
        rows, failed = list[dict[str, Any]](), list[str]()
        if options.extra:
            from scex_sumo.extrapolation.extras import Work, work_of

            work = Work(job=job, part=all_futures, workers=workers, options=options)
            rows, failed = work_of(options.extra, work)
    info = _info(job, options.command, all_futures)
    info["recorded"] = None if recorded is None else recorded_info(job.scene, recorded)
    notes = [*failed, *outcome_notes(job.scene, recorded), *workers.deaths]
    folder.finish(info | {"run_notes": [*notes, *info["run_notes"]], "rows": rows})
    run = Run(folder.path, temporary)
    run.intervals = job.intervals
    return run, job


def _folder_and_job(
    scene: SeedScene, settings: RunSettings, options: RunOptions, models: ModelSet, path: Path
) -> tuple[ResultFolder, Job]:
    """Open the folder of a run; return it with the run's job."""
    if scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    added: tuple[str, ...] = ()
    if scene.obstacles is not None and settings.vru != "replay":
        from scex_sumo.results.participants import with_people

        taking = with_people(scene, settings.vru)
        added = taking.notes[len(scene.notes) :]
        scene = dataclasses.replace(taking, notes=scene.notes)
    if settings.within is not None:
        scene = settings.within.simulated(scene, settings.steps, [*settings.assign, *settings.under_test])
    settings.check_size(settings.count or 1, scene.vehicles)
    assignment = models.draw(scene, futures=settings.count, seed=settings.seed, keep=options.cache)
    settings.check_size(len(assignment), scene.vehicles)
    models.try_on(scene, seed=settings.seed)
    own = {**models.to_json(), **settings.to_json(), "futures": len(assignment)}
    identity = {"version": __version__, "scene": digest(scene), **own}
    folder = ResultFolder(path, identity, overwrite=options.overwrite)
    assert scene.road is not None
    file = folder.path / "sumo" / f"{scene.road.name}.net.xml"
    signals = signals_of(scene) if settings.obeys else None
    with writing(file):
        net = converted(scene.road, file, keep=options.cache, signals=signals, time_s=scene.time_s)
    scene, net = ruled(scene, dataclasses.replace(net, notes=(*net.notes, *added)), settings)
    gui, conflicts = options.gui, options.is_reference
    return folder, Job(scene, net, settings, models, assignment, folder.path, gui, conflicts=conflicts)


def checked_models(settings: RunSettings, options: RunOptions) -> ModelSet:
    """Build the models of a run; raise a `UsageError` for what can be known without the seed scene."""
    models = ModelSet.of(settings)
    by_sumo = [name for name, m in zip(models.names, models.built, strict=True) if driven_by_sumo(m)]
    if (by_sumo or options.gui) and not WORLDS.load(settings.world).has_sumo:
        what = f"{by_sumo[0]} is driven by SUMO" if by_sumo else "--gui shows SUMO"
        raise UsageError(f"--world {settings.world}: {what}, which is not there; use --world sumo")
    if options.human is not None:
        parse_models(options.human)
    return models


def _info(job: Job, command: Sequence[str] | None, all_futures: Part) -> dict[str, Any]:
    settings, scene = job.settings, job.scene
    info: dict[str, Any] = {
        "scex_sumo": __version__,
        "command": list(command) if command else None,
        **job.info,
        "thresholds": {**thresholds_of(settings.measured), **settings.thresholds},
        "net": job.road.name,
        "net_notes": [*job.net.notes, *(loss.note for loss in job.net.losses)],
        "run_notes": [],
        "fallbacks": [],
        "versions": versions(),
    }
    if all_futures.fallbacks is not None:
        from scex_sumo.results.tables.fallbacks import count_fallbacks

        plans = -(-settings.steps // settings.replan)
        info["fallbacks"] = count_fallbacks(all_futures.fallbacks, job.assignment, job.models.names, plans)
    if scene.rules is not None:
        from scex_sumo.rules.holds import precedence

        info["precedence"] = precedence(scene, job.road)
    if settings.within is not None:
        vehicles = settings.vehicles_that_count(scene) or ()
        words, inside = settings.within.words(), [int(scene.track_ids[v]) for v in vehicles]
        counted = f"only pairs with one of {len(inside)} of {scene.vehicles} vehicles count"
        info["run_notes"].append(f"{counted}: those {words} at the seed moment")
        info["region"] |= {"words": words, "vehicles": inside}
    return info


def _run_all(job: Job, workers: Workers, progress: Progress | None) -> None:
    done, total, steps = set(Parts(job.folder).futures.tolist()), len(job.assignment), job.settings.steps
    size = batch_size(job, workers.processes)
    batches = batches_of([c for c in range(total) if c not in done], size, apart=job.apart)
    ticks = len(done) * steps

    def on_step(futures: int) -> None:
        nonlocal ticks
        ticks += futures
        if progress is not None:
            progress(ticks, total * steps)

    on_step(0)
    if batches:
        workers.run(job, batches, together=max(batch_size(job) // size, 1), on_step=on_step)
