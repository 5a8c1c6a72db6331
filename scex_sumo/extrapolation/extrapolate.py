"""The whole way from a seed scene to a result folder."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.converters.net.convert import convert
from scex_sumo.extrapolation.casting import Models, try_drivers
from scex_sumo.extrapolation.fallbacks import count_fallbacks
from scex_sumo.extrapolation.job import Job, batch_size, batches_of
from scex_sumo.extrapolation.settings import Prepared, Progress, Request, prepare
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.extrapolation.writing import handover_notes, write_tables
from scex_sumo.metrics.registry import COLUMNS, THRESHOLDS
from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.parts import Part
from scex_sumo.results.provenance import describe, digest, versions
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import BASELINE
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.bands import Look, grow, look
from scex_sumo.statistics.designs import DEFAULT_DESIGN
from scex_sumo.version import __version__

DEFAULT_CHILDREN = 385  # the paper's sample size: a 95 % interval of +-5 % around a share of one half
DEFAULT_STEPS = 30
DEFAULT_REPLAN = 5
LEARNED = ("scex_sumo.behaviors.learned.driver",)  # takes seconds to import


def extrapolate(
    scene: SeedScene,
    *,
    models: Models = DEFAULT_MODELS,
    children: int | str = DEFAULT_CHILDREN,
    assign: Mapping[int, str] | None = None,
    under_test: Mapping[int, str | None] | None = None,
    baseline: bool = True,
    steps: int = DEFAULT_STEPS,
    replan: int = DEFAULT_REPLAN,
    design: str = DEFAULT_DESIGN,
    until_band: float | None = None,
    seed: int = 0,
    workers: int | Workers = 1,
    batch: int | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    keep_plans: bool = True,
    gui: bool = False,
    thresholds: Mapping[str, float] | None = None,
    command: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Let a seed scene run on many times with different drivers, and measure every child scenario.

    Args:
        scene: the seed scene, with its road.
        models: behaviour models to draw from, ``name[:parameter=value]...[@weight]``, comma-separated
            or a list.
        children: number of children, or ``"all"`` for every combination.
        assign: model by track id for vehicles that are not to be drawn; a model of your own is under test.
        under_test: model by track id for vehicles whose own encounters are measured apart, see
            `Run.under_test`; None leaves a vehicle to what is drawn.
        baseline: run every child a second time without the models under test, to compare with.
        steps: steps of 0.1 s per child.
        replan: steps that a plan is followed before the next, 1 to 30.
        design: how the assignments are drawn, one of `scex_sumo.statistics.designs.DESIGNS`.
        until_band: go on until the 95 % bands of all cumulative distributions have this half-width, see
            `scex_sumo.statistics.bands.Bands`; ``children`` is then the most that are run.
        seed: the same seed gives the same result.
        workers: processes that share the children, or those that were started before; the result does not
            depend on it.
        batch: children side by side in one world, None for about 2400 vehicles; the result does not depend
            on it.
        out: result folder; None keeps the result in a temporary one as long as the returned run lives.
        overwrite: replace the result of another run in ``out``.
        keep_plans: write ``plans.parquet``, from which gap times can be evaluated again.
        gui: show the run live in sumo-gui.
        thresholds: by metric column, on top of the defaults.
        command: the command line, for ``run.json``.
        progress: called with (steps done, steps in all) as the run advances.

    Returns:
        The finished run.

    Raises:
        UsageError: an argument that makes no sense.
        ResultError: the folder cannot be written or holds another run.
        ScexError: anything else that the input or the environment does wrong.
    """
    return _carry_out(
        Request(
            scene=scene,
            models=models,
            children=children,
            assign=assign or {},
            under_test=under_test or {},
            baseline=baseline,
            steps=steps,
            replan=replan,
            design=design,
            until_band=until_band,
            seed=seed,
            workers=workers,
            batch=batch,
            out=out,
            overwrite=overwrite,
            keep_plans=keep_plans,
            gui=gui,
            thresholds=thresholds or {},
            command=command,
            progress=progress,
        )
    )


def _carry_out(request: Request) -> Run:
    """Run a request, and write the result."""
    watch = _Stopwatch()
    prepared = prepare(request)
    scene = request.scene
    assert scene.road is not None
    with _at_work(request.workers, prepared.most, request.gui) as pool:  # helpers start meanwhile
        if prepared.weights:
            pool.prepare(LEARNED)
        assignment = prepared.first_draw()
        try_drivers(prepared.casting, prepared.drivers, scene, seed=request.seed)
        temporary = tempfile.TemporaryDirectory(prefix="scex-sumo-") if request.out is None else None
        settings = prepared.settings(assignment)
        identity = {"version": __version__, "scene": digest(scene), **settings}
        path = Path(temporary.name if temporary else str(request.out))
        folder = ResultFolder(path, identity, overwrite=request.overwrite)
        net = convert(scene.road, folder.path / "sumo" / f"{scene.road.name}.net.xml")
        watch.lap("convert")
        job, band = _run_children(prepared, prepared.job(net, assignment, folder.path), folder, pool)
        if prepared.compared and not (folder.path / BASELINE / "run.json").is_file():
            _carry_out(_without_test(prepared, job, pool))
    watch.lap("simulate_and_measure")
    part = write_tables(folder, job)
    info = _info(prepared, settings, job, band, part, pool.deaths)
    folder.finish({**info, "timings_s": watch.lap("write")})
    return Run(folder.path, temporary)


def _info(
    prepared: Prepared,
    settings: Mapping[str, Any],
    job: Job,
    band: Look | None,
    part: Part,
    deaths: Sequence[str],
) -> dict[str, Any]:
    """What ``run.json`` says but for the times.

    Args:
        prepared: what was asked for.
        settings: its settings, the number of children as it was asked for.
        job: what was run.
        band: how wide the bands are, where they decide when it is enough.
        part: all children.
        deaths: one phrase for each worker that was replaced.
    """
    request = prepared.request
    return {
        "scex_sumo": __version__,
        "command": list(request.command) if request.command else None,
        "seed_scene": describe(job.scene),
        **settings,
        "children": len(job.assignment),
        "band": None if band is None else {"asked": request.until_band, **dataclasses.asdict(band)},
        "thresholds": {**THRESHOLDS, **request.thresholds},
        "net": job.road.name,
        "net_notes": list(job.net.notes),
        "run_notes": [*handover_notes(job, part), *deaths],
        "fallbacks": count_fallbacks(part.fallbacks, job.assignment, job.names, -(-job.steps // job.replan)),
        "versions": versions(learned=bool(prepared.weights)),
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


def _run_children(
    prepared: Prepared, job: Job, folder: ResultFolder, pool: Workers
) -> tuple[Job, Look | None]:
    """Run all children, or as many as a band takes; the job of those, and how wide the bands are."""
    request, most = prepared.request, prepared.most
    progress = _part_of(request.progress, 0, 2) if prepared.compared else request.progress
    go = partial(_run_all, folder=folder, workers=pool, batch=request.batch, progress=progress)
    if request.until_band is None or most is None:
        go(job)
        return job, None

    def measure(count: int) -> Look:
        grown = dataclasses.replace(job, assignment=prepared.draw(count))
        go(grown)
        return look(grown.assignment, *folder.values(count), COLUMNS, design=request.design)

    band = grow(measure, band=request.until_band, most=most)
    return dataclasses.replace(job, assignment=prepared.draw(band.children)), band


def _without_test(prepared: Prepared, job: Job, pool: Workers) -> Request:
    """The run to compare with: the same children, with nobody under test driven by another model."""
    return dataclasses.replace(
        prepared.request,
        children="all" if prepared.most is None else len(job.assignment),
        assign=prepared.assign,
        under_test=dict.fromkeys(prepared.tested),
        baseline=True,
        until_band=None,
        workers=pool,
        out=job.folder / BASELINE,
        overwrite=True,
        gui=False,
        progress=_part_of(prepared.request.progress, 1, 2),
    )


def _part_of(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Progress of one of several equal parts, told as that of the whole."""
    if progress is None:
        return None
    whole = progress
    return lambda done, total: whole(part * total + done, parts * total)


@contextlib.contextmanager
def _at_work(workers: int | Workers, most: int | None, gui: bool) -> Iterator[Workers]:
    """The processes for at most so many children; those that the caller started stay the caller's."""
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(1 if gui else min(workers, most or workers)) as pool:
        yield pool


def _run_all(
    job: Job, folder: ResultFolder, workers: Workers, batch: int | None, progress: Progress | None
) -> None:
    """Run the children of a job that the folder has not yet."""
    done = folder.done()
    total = len(job.assignment)
    size = batch if batch is not None else batch_size(job, processes=workers.processes)
    batches = batches_of([c for c in range(total) if c not in done], size, apart=job.apart)
    ticks = len(done) * job.steps
    if progress is not None:
        progress(ticks, total * job.steps)

    def on_step(children: int) -> None:
        nonlocal ticks
        ticks += children
        if progress is not None:
            progress(ticks, total * job.steps)

    for _ in workers.run(job, batches, on_step=on_step):
        pass
