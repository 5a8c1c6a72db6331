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

from scex_sumo import __version__
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.casting import (
    Models,
    cast_models,
    draw_assignments,
    drivers,
    number_of_children,
    put_under_test,
    sources_of,
    try_drivers,
    weights_of,
)
from scex_sumo.colors import model_colors
from scex_sumo.converters.sumo_net import convert
from scex_sumo.density import THRESHOLDS
from scex_sumo.designs import DEFAULT_DESIGN
from scex_sumo.errors import UsageError
from scex_sumo.fallbacks import count_fallbacks
from scex_sumo.job import Job, batch_size, batches_of
from scex_sumo.metrics.evaluate import COLUMNS, PAPER_PRESET
from scex_sumo.provenance import describe, fingerprint, versions
from scex_sumo.results import (
    ResultFolder,
)
from scex_sumo.run import Run
from scex_sumo.scene import IntArray, SeedScene
from scex_sumo.sequential import Look, check_band, grow, look
from scex_sumo.under_test import BASELINE
from scex_sumo.workers import Workers
from scex_sumo.writing import handover_notes, write_tables

DEFAULT_CHILDREN = 385  # the paper's sample size: a 95 % interval of +-5 % around a share of one half
DEFAULT_STEPS = 30
DEFAULT_REPLAN = 5
LEARNED = ("scex_sumo.behaviors.learned.driver",)  # takes seconds to import
MAX_REPLAN = 30  # models plan at least 30 steps


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
        design: how the assignments are drawn, one of `scex_sumo.designs.DESIGNS`.
        until_band: go on until the 95 % bands of all cumulative distributions have this half-width, see
            `scex_sumo.sequential.Bands`; ``children`` is then the most that are run.
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
    started = time.perf_counter()
    _check(scene, steps, replan, seed, workers, batch)
    assign, tested = put_under_test(assign or {}, under_test or {}, own=baseline)
    casting, most = cast_models(models, assign, tested), number_of_children(children)
    draw = partial(draw_assignments, casting, scene.track_ids, seed=seed, design=design)
    if until_band is not None:
        _check_until(until_band, design, most)
    built = drivers(casting)
    with _at_work(workers, most, gui) as pool:  # helpers start while this process draws and converts
        weights = weights_of(casting, built)
        if weights:
            pool.prepare(LEARNED)
        assignment = draw(children=most if until_band is None else 1)
        try_drivers(casting, built, scene, seed=seed)
        temporary = tempfile.TemporaryDirectory(prefix="scex-sumo-") if out is None else None
        settings: dict[str, Any] = {
            "models": [{"model": str(s), "weight": s.weight} for s in casting.drawn],
            "weights": weights,
            "sources": sources_of(casting, built),
            "assign": {str(t): casting.names[m] for t, m in sorted(casting.fixed.items())},
            "under_test": {str(t): model for t, model in sorted(tested.items())},
            "children": len(assignment) if until_band is None else most,
            "steps": steps,
            "replan": replan,
            "design": "all" if most is None else design,
            "until_band": until_band,
            "seed": seed,
            "preset": PAPER_PRESET,
            "keep_plans": keep_plans,
        }
        identity = {"version": __version__, "scene": fingerprint(scene), **settings}
        folder = ResultFolder(Path(temporary.name if temporary else str(out)), identity, overwrite=overwrite)
        assert scene.road is not None
        net = convert(scene.road, folder.path / "sumo" / f"{scene.road.name}.net.xml")
        converted = time.perf_counter()
        job = Job(
            scene=scene,
            net=net,
            models=built,
            names=casting.names,
            colors=model_colors(casting.names),
            assignment=assignment,
            seed=seed,
            steps=steps,
            replan=replan,
            folder=folder.path,
            keep_plans=keep_plans,
            gui=gui,
            tested=tuple(v for v, track in enumerate(scene.track_ids.tolist()) if track in tested),
        )
        baseline = baseline and any(model is not None for model in tested.values())
        tick = _part_of(progress, 0, 2) if baseline else progress
        go = partial(_run_all, folder=folder, workers=pool, batch=batch, progress=tick)
        band = None
        if until_band is None or most is None:
            go(job)
        else:
            job, band = _run_until(job, folder, go, draw, until_band, most, design)
        if baseline and not (folder.path / BASELINE / "run.json").is_file():
            extrapolate(
                scene,
                models=models,
                children="all" if most is None else len(job.assignment),
                assign=assign,
                under_test=dict.fromkeys(tested),
                steps=steps,
                replan=replan,
                design=design,
                seed=seed,
                workers=pool,
                batch=batch,
                out=folder.path / BASELINE,
                overwrite=True,
                keep_plans=keep_plans,
                thresholds=thresholds,
                command=command,
                progress=_part_of(progress, 1, 2),
            )
    simulated = time.perf_counter()
    part = write_tables(folder, job)
    folder.finish(
        {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            "seed_scene": describe(scene),
            **settings,
            "children": len(job.assignment),
            "band": None if band is None else {"asked": until_band, **dataclasses.asdict(band)},
            "thresholds": {**THRESHOLDS, **(thresholds or {})},
            "net": scene.road.name,
            "net_notes": list(net.notes),
            "run_notes": [*handover_notes(job, part), *pool.deaths],
            "fallbacks": count_fallbacks(part.fallbacks, job.assignment, job.names, -(-steps // replan)),
            "versions": versions(learned=bool(weights)),
            "timings_s": {
                "convert": round(converted - started, 3),
                "simulate_and_measure": round(simulated - converted, 3),
                "write": round(time.perf_counter() - simulated, 3),
            },
        }
    )
    return Run(folder.path, temporary)


def _part_of(
    progress: Callable[[int, int], None] | None, part: int, parts: int
) -> Callable[[int, int], None] | None:
    """Progress of one of several equal parts, told as that of the whole."""
    if progress is None:
        return None
    whole = progress
    return lambda done, total: whole(part * total + done, parts * total)


def _check_until(until_band: float, design: str, most: int | None) -> None:
    check_band(until_band, design)
    if most is None:
        raise UsageError("--until-band: all combinations leave nothing to estimate; give no --children all")


def _run_until(
    job: Job,
    folder: ResultFolder,
    go: Callable[[Job], None],
    draw: Callable[..., IntArray],
    until_band: float,
    most: int,
    design: str,
) -> tuple[Job, Look]:
    """Run more and more children until the bands are narrow enough; the last job, and how wide they are."""

    def measure(count: int) -> Look:
        grown = dataclasses.replace(job, assignment=draw(children=count))
        go(grown)
        return look(grown.assignment, *folder.values(count), COLUMNS, design=design)

    band = grow(measure, band=until_band, most=most)
    return dataclasses.replace(job, assignment=draw(children=band.children)), band


@contextlib.contextmanager
def _at_work(workers: int | Workers, most: int | None, gui: bool) -> Iterator[Workers]:
    """The processes for at most so many children; those that the caller started stay the caller's."""
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(1 if gui else min(workers, most or workers)) as pool:
        yield pool


def _check(
    scene: SeedScene, steps: int, replan: int, seed: int, workers: int | Workers, batch: int | None
) -> None:
    if scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    if steps < 1:
        raise UsageError(f"--steps: got {steps}, needs at least 1")
    if not 1 <= replan <= MAX_REPLAN:
        raise UsageError(f"--replan: got {replan}, needs 1 to {MAX_REPLAN} (models plan {MAX_REPLAN} steps)")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    if isinstance(workers, int) and workers < 1:
        raise UsageError(f"--workers: got {workers}, needs at least 1")
    if batch is not None and batch < 1:
        raise UsageError(f"--batch: got {batch}, needs at least 1")


def _run_all(
    job: Job,
    folder: ResultFolder,
    workers: Workers,
    batch: int | None,
    progress: Callable[[int, int], None] | None,
) -> None:
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
