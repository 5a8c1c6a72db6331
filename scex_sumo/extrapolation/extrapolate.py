"""Extrapolation of a seed scene: the whole way to a result folder."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from scex_sumo.arrays import IntArray
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.behaviors.spec import LEARNED as LEARNED_MODELS
from scex_sumo.converters.net.kept import converted
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.fallbacks import count_fallbacks
from scex_sumo.extrapolation.job import Job, batch_size, batches_of
from scex_sumo.extrapolation.measure import measure_recorded
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.notes import handover_notes, outcome_notes, recorded_info
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.workers.pool import Workers
from scex_sumo.extrapolation.writing import write_tables
from scex_sumo.files import TemporaryFolder, writing
from scex_sumo.metrics.registry import thresholds_of
from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.parts import Part, Parts
from scex_sumo.results.provenance import describe, digest, versions
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import BASELINE
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.bands import Look, grow, look
from scex_sumo.version import __version__
from scex_sumo.world.session import load_sumo

SETTINGS = tuple(field.name for field in dataclasses.fields(RunSettings))

Progress: TypeAlias = Callable[[int, int], None]


def extrapolate(
    scene: SeedScene,
    *,
    out: str | Path | None = None,
    overwrite: bool = False,
    workers: int | Workers = 1,
    batch: int | None = None,
    gui: bool = False,
    cache: bool = True,
    compared: bool = True,
    progress: Progress | None = None,
    command: Sequence[str] | None = None,
    begun: Callable[[Path, int], None] | None = None,
    **settings: Any,
) -> Run:
    """Let a seed scene run on many times with different drivers, and measure every child scenario.

    Args:
        scene: the seed scene, with its road.
        out: result folder; None keeps the result in a temporary one as long as the returned run lives.
        overwrite: replace the result of another run in ``out``.
        workers: processes that share the children, or those that were started before; the result does not
            depend on it.
        batch: children side by side in one world, None for about 6000 vehicles; the result does not depend
            on it.
        gui: show the run live in sumo-gui.
        cache: keep the converted net, what networks make of the map, and the assignments in
            ``~/.cache/scex-sumo`` for the next run.
        compared: whether a checked world is compared with SUMO's; if not, it has been elsewhere.
        progress: called with (steps done, steps in all) as the run advances.
        command: the command line, for ``run.json``.
        begun: called with the result folder and the number of children when these begin.
        settings: all that decides on the values, each of the attributes of
            `scex_sumo.extrapolation.settings.RunSettings`: models, assign, under_test, baseline, children,
            design, until_band, steps, replan, seed, world, preset, metrics, thresholds, reflect, keep_plans.

    Returns:
        The finished run.

    Raises:
        UsageError: an argument that makes no sense.
        ResultError: the folder cannot be written or holds another run.
        ScexError: anything else that the input or the environment does wrong.
    """
    wanted, watch = _checked(scene, batch, settings), _Stopwatch()
    models = ModelSet.of(wanted)
    if cache:
        models.keep_images()
    with _at_work(workers, wanted.count, gui) as pool:  # helpers start meanwhile
        assignment = models.draw(
            scene.track_ids,
            children=wanted.count if wanted.until_band is None else 1,
            seed=wanted.seed,
            design=wanted.design,
            keep=cache,
        )
        wanted.check_size(len(assignment), scene.vehicles)
        models.try_on(scene, seed=wanted.seed)
        _check_world(wanted, models, gui)
        temporary = TemporaryFolder() if out is None else None
        path = Path(temporary.name) / "run" if temporary else Path(str(out))
        folder = ResultFolder(path, _identity(scene, wanted, models, assignment), overwrite=overwrite)
        assert scene.road is not None
        net_path = folder.path / "sumo" / f"{scene.road.name}.net.xml"
        with writing(net_path):
            net = converted(scene.road, net_path, keep=cache)
        watch.lap("convert")
        if begun is not None:
            begun(folder.path, len(assignment))
        job = Job(scene, net, wanted, models, assignment, folder.path, gui, compared=compared)
        first = _part_of(progress, 0, 2) if wanted.compared else progress
        job, band = _run_children(job, partial(_run_all, workers=pool, batch=batch, progress=first))
        if wanted.compared and not (folder.path / BASELINE / "run.json").is_file():
            extrapolate(
                scene,
                out=folder.path / BASELINE,
                overwrite=True,
                workers=pool,
                batch=batch,
                cache=cache,
                progress=_part_of(progress, 1, 2),
                command=command,
                **_without_test(job),
            )
        watch.lap("simulate_and_measure")
        recorded = measure_recorded(
            scene, wanted.steps, replan=wanted.replan, metrics=wanted.measured, preset=wanted.rule
        )
        part = write_tables(folder, job, recorded, workers=pool)
    notes = [*handover_notes(job, part), *outcome_notes(scene, recorded), *pool.deaths]
    info = _info(job, command, band, part, notes) | {"recorded": recorded_info(scene, recorded)}
    folder.finish({**info, "timings_s": watch.lap("write")})
    run = Run(folder.path, temporary)
    run.intervals = job.intervals
    return run


def load_for(settings: Mapping[str, Any]) -> None:
    """Import what a run with such settings needs, before there are workers: they are copies of this process.

    Raises:
        UsageError: a setting that makes no sense.
    """
    wanted = RunSettings(**settings)
    if wanted.world == "sumo":
        load_sumo()
    if any(spec.name in LEARNED_MODELS for spec in wanted.drawn):
        import scex_sumo.behaviors.learned.driver  # noqa: F401


def _checked(scene: SeedScene, batch: int | None, settings: Mapping[str, Any]) -> RunSettings:
    """The settings, where all arguments of a run make sense."""
    unknown = sorted(set(settings) - set(SETTINGS))
    if unknown:
        raise TypeError(f"extrapolate() has no setting {unknown[0]!r}; known: {', '.join(SETTINGS)}")
    if scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    if batch is not None and batch < 1:
        raise UsageError(f"--batch: got {batch}, needs at least 1")
    wanted = RunSettings(**settings)
    wanted.check_size(wanted.count or 1, scene.vehicles)
    return wanted


def _check_world(settings: RunSettings, models: ModelSet, gui: bool) -> None:
    """A `UsageError` where the plain world cannot do what is asked of it."""
    by_sumo = [name for name, m in zip(models.names, models.built, strict=True) if isinstance(m, SumoDriver)]
    if settings.world == "plain" and (by_sumo or gui):
        who = f"{by_sumo[0]} is driven by SUMO" if by_sumo else "--gui shows SUMO"
        raise UsageError(f"--world plain: {who}, which is not there; use --world sumo")


def _identity(
    scene: SeedScene, settings: RunSettings, models: ModelSet, assignment: IntArray
) -> dict[str, Any]:
    """What decides on the values of a run: the same in a folder, and the run goes on there."""
    children = {"children": len(assignment)} if settings.until_band is None else {}
    own = {**models.to_json(), **settings.to_json(), **children}
    return {"version": __version__, "scene": digest(scene), **own}


def _info(
    job: Job, command: Sequence[str] | None, band: Look | None, part: Part, notes: Sequence[str]
) -> dict[str, Any]:
    """What ``run.json`` says but for the times.

    Args:
        job: what was run.
        command: the command line.
        band: how wide the bands are, where they decide when it is enough.
        part: all children.
        notes: what the reader should know of the run, one phrase each.
    """
    settings, names = job.settings, job.models.names
    plans = -(-settings.steps // settings.replan)  # of a vehicle in a child
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
        "net_notes": [*job.net.notes, *map(str, job.net.losses)],
        "run_notes": list(notes),
        "fallbacks": count_fallbacks(part.fallbacks, job.assignment, names, plans),
        "versions": versions(),
    }


class _Stopwatch:
    """How long each part of the work takes, in s."""

    def __init__(self) -> None:
        self._last, self._laps = time.perf_counter(), dict[str, float]()

    def lap(self, part: str) -> dict[str, float]:
        """End a part of the work; the times of all that have ended."""
        now = time.perf_counter()
        self._laps[part], self._last = round(now - self._last, 3), now
        return dict(self._laps)


def _run_children(job: Job, go: Callable[[Job], None]) -> tuple[Job, Look | None]:
    """Run all children, or as many as a band takes; the job of those, and how wide the bands are."""
    settings = job.settings
    if settings.until_band is None or settings.count is None:
        go(job)
        return job, None

    def measure(count: int) -> Look:
        grown = job.of(count)
        go(grown)
        return look(grown.intervals, *Parts(job.folder).values(count), settings.columns)

    band = grow(measure, band=settings.until_band, most=settings.count)
    return job.of(band.children), band


def _without_test(job: Job) -> dict[str, Any]:
    """Settings of the run to compare with: the same children, nobody under test driven by another model."""
    settings = dataclasses.replace(
        job.settings,
        children="all" if job.settings.count is None else len(job.assignment),
        under_test=dict.fromkeys(job.settings.under_test),
        until_band=None,
    )
    return {name: getattr(settings, name) for name in SETTINGS}


def _part_of(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Progress of one of several equal parts, told as that of the whole."""
    if progress is None:
        return None
    return lambda done, total: progress(part * total + done, parts * total)


@contextlib.contextmanager
def _at_work(workers: int | Workers, most: int | None, gui: bool) -> Iterator[Workers]:
    """The processes for at most so many children; those that the caller started stay the caller's."""
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(1 if gui else min(workers, most or workers)) as pool:
        yield pool


def _run_all(job: Job, workers: Workers, batch: int | None, progress: Progress | None) -> None:
    """Run the children of a job that its folder has not yet."""
    done, total, steps = set(Parts(job.folder).children.tolist()), len(job.assignment), job.settings.steps
    shared = {"processes": workers.processes, "occupied": workers.occupied}
    size = batch if batch is not None else batch_size(job, **shared)
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
