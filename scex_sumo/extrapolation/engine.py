"""Run of a seed scene, from checked settings to a finished result folder; its human-like reference."""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.progress import Progress
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.certainty.exact import find_exact, why_not_exact
from scex_sumo.certainty.tables import remainder_of
from scex_sumo.converters.net.convert import converted
from scex_sumo.extrapolation.job import Job, batch_size, batches_of
from scex_sumo.extrapolation.measure import measure_recorded
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.rollout import count_fallbacks
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.extrapolation.writing import handover_notes, outcome_notes, recorded_info, write_tables
from scex_sumo.metrics.registry import thresholds_of
from scex_sumo.results.exact import EXACT, Exact, remove_exact, write_exact
from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.info import describe, digest, versions
from scex_sumo.results.parts import Part, Parts
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.bands import Look, grow, look
from scex_sumo.studies.under_test.results import BASELINE
from scex_sumo.world.base import WORLDS

REFERENCE_CHILDREN = 117
"""A share then has a 95 % interval of at most +-9 %."""
REFERENCE_STEPS = 30
"""Up to so many steps, a reference has all `REFERENCE_CHILDREN`, however few the run has."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a run that change no value of its result, as of `extrapolate`.

    Attributes:
        compared: compare a checked world with SUMO's.
        exact: find exact probabilities; they may end a run with ``until_band`` earlier.
    """

    batch: int | None = None
    gui: bool = False
    cache: bool = True
    compared: bool = True
    exact: bool = True
    progress: Progress | None = None
    command: Sequence[str] | None = None

    def __post_init__(self) -> None:
        if self.batch is not None and self.batch < 1:
            raise UsageError(f"--batch: got {self.batch}, needs at least 1")


DEFAULT_OPTIONS = RunOptions()


def run_scene(
    scene: SeedScene,
    settings: RunSettings,
    *,
    out: str | Path | None,
    workers: Workers,
    overwrite: bool = False,
    options: RunOptions = DEFAULT_OPTIONS,
) -> Run:
    """Simulate and measure the children of a seed scene that has a road, as `extrapolate`."""
    if scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    settings.check_size(settings.count or 1, scene.vehicles)
    vehicles = settings.region.vehicles(scene)
    watch, models = _Stopwatch(), ModelSet.of(settings)
    if options.cache:
        models.keep_images()
    assignment = models.draw(
        scene.track_ids,
        children=settings.count if settings.until_band is None else 1,
        seed=settings.seed,
        design=settings.design,
        keep=options.cache,
    )
    settings.check_size(len(assignment), scene.vehicles)
    models.try_on(scene, seed=settings.seed)
    check_world(settings, models, gui=options.gui)
    temporary = TemporaryFolder() if out is None else None
    path = Path(temporary.name) / "run" if temporary else Path(str(out))
    folder = ResultFolder(path, _identity(scene, settings, models, assignment), overwrite=overwrite)
    net_path = folder.path / "sumo" / f"{scene.road.name}.net.xml"
    with writing(net_path):
        net = converted(scene.road, net_path, keep=options.cache)
    watch.lap("convert")
    job = Job(scene, net, settings, models, assignment, folder.path, options.gui, compared=options.compared)
    first = _part_of(options.progress, 0, 2) if settings.compared else options.progress
    run_all = partial(_run_all, workers=workers, batch=options.batch, progress=first)
    job, band, exact = _run_children(job, run_all, partial(_exact, options=options, workers=workers))
    if settings.compared and not (folder.path / BASELINE / "run.json").is_file():
        run_scene(
            scene,
            _without_test(job),
            out=folder.path / BASELINE,
            workers=workers,
            overwrite=True,
            options=dataclasses.replace(options, gui=False, progress=_part_of(options.progress, 1, 2)),
        )
    watch.lap("simulate_and_measure")
    recorded = measure_recorded(
        scene,
        settings.steps,
        replan=settings.replan,
        metrics=settings.measured,
        preset=settings.rule,
        vehicles=vehicles,
    )
    part = write_tables(folder, job, recorded, workers=workers)
    remove_exact(job.folder)
    exact = exact or _exact(job, part, options=options, workers=workers)
    if exact is not None:
        write_exact(exact, job.folder / EXACT)
    watch.lap("exact")
    notes = [*handover_notes(job, part), *outcome_notes(scene, recorded), *workers.deaths]
    info = _info(job, options.command, band, part, notes) | {"recorded": recorded_info(scene, recorded)}
    if vehicles is not None:
        inside = [int(scene.track_ids[v]) for v in vehicles]
        counted = f"only pairs with one of {len(inside)} of {scene.vehicles} vehicles count"
        info["run_notes"].append(f"{counted}: those {settings.region.words()} at the seed moment")
        info["region"] |= {"words": settings.region.words(), "vehicles": inside}
    folder.finish({**info, "timings_s": watch.lap("write")})
    run = Run(folder.path, temporary)
    run.intervals = job.intervals
    return run


def _exact(job: Job, part: Part, *, options: RunOptions, workers: Workers) -> Exact | None:
    """Return the influence tables of a run; None if it has no exact probabilities."""
    if not options.exact or why_not_exact(job.settings, job.models, len(job.assignment)) is not None:
        return None
    assert part.encounters is not None
    return find_exact(job, part.encounters, workers)


def check_world(settings: RunSettings, models: ModelSet, *, gui: bool) -> None:
    """Raise a `UsageError` if SUMO is needed and the world has none."""
    by_sumo = [name for name, m in zip(models.names, models.built, strict=True) if isinstance(m, SumoDriver)]
    if (by_sumo or gui) and not WORLDS.load(settings.world).has_sumo:
        what = f"{by_sumo[0]} is driven by SUMO" if by_sumo else "--gui shows SUMO"
        raise UsageError(f"--world {settings.world}: {what}, which is not there; use --world sumo")


def _identity(
    scene: SeedScene, settings: RunSettings, models: ModelSet, assignment: IntArray
) -> dict[str, Any]:
    children = {"children": len(assignment)} if settings.until_band is None else {}
    own = {**models.to_json(), **settings.to_json(), **children}
    return {"version": __version__, "scene": digest(scene), **own}


def _info(
    job: Job, command: Sequence[str] | None, band: Look | None, part: Part, notes: Sequence[str]
) -> dict[str, Any]:
    settings, names = job.settings, job.models.names
    plans = -(-settings.steps // settings.replan)
    return {
        "scex_sumo": __version__,
        "command": list(command) if command else None,
        "seed_scene": describe(job.scene),
        **job.models.to_json(),
        **settings.to_json(),
        "children": len(job.assignment),
        "band": None if band is None else {"asked": settings.until_band, **dataclasses.asdict(band)},
        "thresholds": {**thresholds_of(settings.measured), **settings.thresholds},
        "net": job.road.name,
        "net_notes": [*job.net.notes, *(loss.note for loss in job.net.losses)],
        "run_notes": list(notes),
        "fallbacks": count_fallbacks(part.fallbacks, job.assignment, names, plans),
        "versions": versions(),
    }


class _Stopwatch:
    def __init__(self) -> None:
        self._last, self._laps = time.perf_counter(), dict[str, float]()

    def lap(self, part: str) -> dict[str, float]:
        """End a part of the run; return the times of all parts so far, s."""
        now = time.perf_counter()
        self._laps[part], self._last = round(now - self._last, 3), now
        return dict(self._laps)


def _run_children(
    job: Job, run: Callable[[Job], None], find: Callable[[Job, Part], Exact | None]
) -> tuple[Job, Look | None, Exact | None]:
    settings, tried, exact = job.settings, False, None
    if settings.until_band is None or settings.count is None:
        run(job)
        return job, None, None
    band = settings.until_band

    def measure(count: int) -> Look:
        nonlocal tried, exact
        grown = job.of(count)
        run(grown)
        parts = Parts(job.folder)
        found = look(grown.intervals, *parts.values(count), settings.columns)
        if tried or found.width <= band or remainder_of(count) > band:
            return found
        tried, exact = True, find(grown, parts.read(0, count, plans=False))
        if exact is None or exact.p_collision() is None or exact.remainder > band:
            exact = None
            return found
        return dataclasses.replace(found, remainder=exact.remainder)

    last = grow(measure, band=band, most=settings.count)
    return job.of(last.children), last, exact


def _without_test(job: Job) -> RunSettings:
    return dataclasses.replace(
        job.settings,
        children="all" if job.settings.count is None else len(job.assignment),
        under_test=dict.fromkeys(job.settings.under_test),
        until_band=None,
    )


def _part_of(progress: Progress | None, part: int, parts: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done, total: progress(part * total + done, parts * total)


def _run_all(job: Job, workers: Workers, batch: int | None, progress: Progress | None) -> None:
    done, total, steps = set(Parts(job.folder).children.tolist()), len(job.assignment), job.settings.steps
    size = batch if batch is not None else batch_size(job, workers.processes)
    batches = batches_of([c for c in range(total) if c not in done], size, apart=job.apart)
    ticks = len(done) * steps

    def on_step(children: int) -> None:
        nonlocal ticks
        ticks += children
        if progress is not None:
            progress(ticks, total * steps)

    on_step(0)
    for _ in workers.run(job, batches, on_step=on_step):
        pass


def add_reference(
    run: Run,
    scene: SeedScene,
    models: Models,
    settings: RunSettings,
    *,
    workers: Workers,
    options: RunOptions = DEFAULT_OPTIONS,
) -> Run:
    """Run the reference of a run into its folder ``reference/``; a finished one is kept.

    Args:
        models: human-like ones, drawn for all vehicles.
        settings: of the run.
    """
    children = reference_children(run.children, settings.steps)
    wanted = RunSettings(
        models=models,
        children=children,
        steps=settings.steps,
        replan=settings.replan,
        seed=settings.seed,
        preset=settings.preset,
        metrics=settings.metrics,
        thresholds=settings.thresholds,
        reflect=settings.reflect,
        region=settings.region,
        world="checked" if WORLDS.load(settings.world).has_sumo else "plain",
    )
    quiet = dataclasses.replace(options, batch=None, gui=False)
    folder = run.folder / REFERENCE
    return run_scene(scene, wanted, out=folder, workers=workers, overwrite=True, options=quiet)


def reference_children(children: int, steps: int) -> int:
    """Return the number of children of the reference of a run.

    There are fewer than `REFERENCE_CHILDREN` if they would cost more than the run and than `REFERENCE_STEPS`
    steps of all.
    """
    return min(REFERENCE_CHILDREN, max(children, REFERENCE_CHILDREN * REFERENCE_STEPS // steps))


def drop_reference(run: Run) -> None:
    """Remove the reference of an earlier run from a result folder."""
    shutil.rmtree(run.folder / REFERENCE, ignore_errors=True)
