"""The whole way from a seed scene to a result folder."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import platform
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo import __version__
from scex_sumo.behaviors.registry import DEFAULT_MODELS, ModelSpec, build, parse_models
from scex_sumo.colors import model_colors
from scex_sumo.converters.sumo_net import convert
from scex_sumo.converters.tracks import write_tracks
from scex_sumo.density import THRESHOLDS
from scex_sumo.designs import DEFAULT_DESIGN
from scex_sumo.errors import UsageError
from scex_sumo.job import Job, batches_of, run_batches
from scex_sumo.measure import measure_recorded
from scex_sumo.metrics.evaluate import COLUMNS, PAPER_PRESET
from scex_sumo.results import Part, ResultFolder, assignments_table, tracks_table, values_table
from scex_sumo.run import Run, densities_table
from scex_sumo.sampling import assignments
from scex_sumo.scene import SeedScene
from scex_sumo.sequential import Look, check_band, grow, look
from scex_sumo.world import TILE_SLOTS

DEFAULT_CHILDREN = 385  # the paper's sample size: a 95 % interval of +-5 % around a share of one half
DEFAULT_STEPS = 30
DEFAULT_REPLAN = 5
DEFAULT_BATCH = TILE_SLOTS
MAX_REPLAN = 30  # models plan at least 30 steps

Models = str | Sequence[str | ModelSpec]


def extrapolate(
    scene: SeedScene,
    *,
    models: Models = DEFAULT_MODELS,
    children: int | str = DEFAULT_CHILDREN,
    assign: Mapping[int, str] | None = None,
    steps: int = DEFAULT_STEPS,
    replan: int = DEFAULT_REPLAN,
    design: str = DEFAULT_DESIGN,
    until_band: float | None = None,
    seed: int = 0,
    workers: int = 1,
    batch: int = DEFAULT_BATCH,
    out: str | Path | None = None,
    overwrite: bool = False,
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
        assign: model by track id for vehicles that are not to be drawn.
        steps: steps of 0.1 s per child.
        replan: steps that a plan is followed before the next, 1 to 30.
        design: how the assignments are drawn, one of `scex_sumo.designs.DESIGNS`.
        until_band: go on until the 95 % bands of all cumulative distributions have this half-width, see
            `scex_sumo.sequential.band_half_width`; ``children`` is then the most that are run.
        seed: the same seed gives the same result.
        workers: processes that share the children; the result does not depend on it.
        batch: children side by side in one world; the result does not depend on it.
        out: result folder; None keeps the result in a temporary one as long as the returned run lives.
        overwrite: replace the result of another run in ``out``.
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
    drawn, specs, fixed = _casting(models, assign or {})
    most = _children(children)
    draw = partial(
        assignments, [s.weight for s in drawn], scene.track_ids, seed=seed, fixed=fixed, design=design
    )
    if until_band is not None:
        check_band(until_band, design)
        if most is None:
            raise UsageError(
                "--until-band: all combinations leave nothing to estimate; give no --children all"
            )
    assignment = draw(children=most if until_band is None else 1)
    temporary = tempfile.TemporaryDirectory(prefix="scex-sumo-") if out is None else None
    configuration: dict[str, Any] = {
        "version": __version__,
        "scene": fingerprint(scene),
        "models": [f"{s}@{s.weight}" for s in drawn],
        "assign": {str(t): str(specs[m]) for t, m in sorted(fixed.items())},
        "children": len(assignment) if until_band is None else most,
        "steps": steps,
        "replan": replan,
        "design": "all" if children == "all" else design,
        "seed": seed,
    }
    if until_band is not None:
        configuration["until_band"] = until_band
    folder = ResultFolder(Path(temporary.name if temporary else str(out)), configuration, overwrite=overwrite)
    assert scene.road is not None
    net = convert(scene.road, folder.path / "sumo" / f"{scene.road.name}.net.xml")
    converted = time.perf_counter()
    job = Job(
        scene=scene,
        net=net,
        models=tuple(build(s) for s in specs),
        names=tuple(str(s) for s in specs),
        colors=model_colors([str(s) for s in specs]),
        assignment=assignment,
        seed=seed,
        steps=steps,
        replan=replan,
        folder=folder.path,
        gui=gui,
    )
    band = None
    if until_band is not None and most is not None:

        def measure(count: int) -> Look:
            part_of = dataclasses.replace(job, assignment=draw(children=count))
            _run_all(part_of, folder, workers, batch, progress)
            return look(part_of.assignment, *folder.values(count), COLUMNS, design=design)

        band = grow(measure, band=until_band, most=most)
        job = dataclasses.replace(job, assignment=draw(children=band.children))
    else:
        _run_all(job, folder, workers, batch, progress)
    simulated = time.perf_counter()
    part = folder.collect(len(job.assignment))
    limits = {**THRESHOLDS, **(thresholds or {})}
    _write_tables(folder, job, part)
    folder.finish(
        {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            "seed_scene": _describe(scene),
            "models": [{"model": str(s), "weight": s.weight} for s in drawn],
            "assign": configuration["assign"],
            "children": len(job.assignment),
            "steps": steps,
            "replan": replan,
            "design": configuration["design"],
            "band": None if band is None else {"asked": until_band, **dataclasses.asdict(band)},
            "seed": seed,
            "thresholds": limits,
            "preset": PAPER_PRESET,
            "net": scene.road.name,
            "net_notes": list(net.notes),
            "versions": _versions(),
            "timings_s": {
                "convert": round(converted - started, 3),
                "simulate_and_measure": round(simulated - converted, 3),
                "write": round(time.perf_counter() - simulated, 3),
            },
        }
    )
    return Run(folder.path, temporary)


def fingerprint(scene: SeedScene) -> str:
    """SHA-256 over everything of a seed scene that its children depend on."""
    digest = hashlib.sha256()
    for array in (scene.track_ids, scene.length, scene.width):
        digest.update(np.ascontiguousarray(array).tobytes())
    for states in (scene.history, scene.future, scene.obstacles.states if scene.obstacles else None):
        if states is not None:
            for array in (states.x, states.y, states.heading, states.speed):
                digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr(scene.types).encode())
    for lane in scene.road.lanes.values() if scene.road is not None else ():
        digest.update(repr((lane.lane_id, lane.kind, lane.speed_limit_mps, lane.successors)).encode())
        digest.update(np.ascontiguousarray(lane.centreline).tobytes())
    return digest.hexdigest()


def _check(scene: SeedScene, steps: int, replan: int, seed: int, workers: int, batch: int) -> None:
    if scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    if steps < 1:
        raise UsageError(f"--steps: got {steps}, needs at least 1")
    if not 1 <= replan <= MAX_REPLAN:
        raise UsageError(f"--replan: got {replan}, needs 1 to {MAX_REPLAN} (models plan {MAX_REPLAN} steps)")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    if workers < 1:
        raise UsageError(f"--workers: got {workers}, needs at least 1")
    if not 1 <= batch <= TILE_SLOTS:
        raise UsageError(f"--batch: got {batch}, needs 1 to {TILE_SLOTS}")


def _children(children: int | str) -> int | None:
    if children == "all":
        return None
    try:
        return int(children)
    except ValueError:
        raise UsageError(f"--children: got {children!r}, needs a number or 'all'") from None


def _casting(
    models: Models, assign: Mapping[int, str]
) -> tuple[list[ModelSpec], list[ModelSpec], dict[int, int]]:
    """Models to draw from, all models of the run, and the index of the model of each fixed vehicle."""
    drawn: list[ModelSpec] = []
    for entry in [models] if isinstance(models, str) else models:
        drawn += parse_models(entry) if isinstance(entry, str) else [entry]
    if not drawn:
        raise UsageError("--models: names no model")
    specs = list(drawn)
    names = [str(s) for s in specs]
    fixed = {}
    for track, text in assign.items():
        (spec,) = parse_models(text)
        if str(spec) not in names:
            specs.append(spec)
            names.append(str(spec))
        fixed[int(track)] = names.index(str(spec))
    return drawn, specs, fixed


def _run_all(
    job: Job, folder: ResultFolder, workers: int, batch: int, progress: Callable[[int, int], None] | None
) -> None:
    done = folder.done()
    total = len(job.assignment)
    batches = batches_of([c for c in range(total) if c not in done], batch)
    count = len(done)
    if progress is not None:
        progress(count * job.steps, total * job.steps)

    if workers > 1 and len(batches) > 1 and not job.gui:
        from joblib import Parallel, delayed

        shares = [batches[i::workers] for i in range(min(workers, len(batches)))]
        parallel = Parallel(n_jobs=len(shares), return_as="generator_unordered")
        for finished in parallel(delayed(run_batches)(job, share) for share in shares):
            count += finished
            if progress is not None:
                progress(count * job.steps, total * job.steps)
        return

    ticks = count * job.steps

    def on_step(children: int) -> None:
        nonlocal ticks
        ticks += children
        if progress is not None:
            progress(ticks, total * job.steps)

    run_batches(job, batches, on_step=on_step)


def _write_tables(folder: ResultFolder, job: Job, part: Part) -> None:
    folder.write_table("tracks.parquet", tracks_table(job.scene, part))
    metrics = values_table(COLUMNS, part.values, part.defined, part.children)
    folder.write_table("metrics.parquet", metrics)
    folder.write_table("worst.parquet", part.worst)
    folder.write_table("assignments.parquet", assignments_table(job.scene, job.assignment, job.names))
    folder.write_table("densities.parquet", densities_table(metrics))
    recorded = measure_recorded(job.scene, job.steps)
    if recorded is not None:
        folder.write_table("recorded.parquet", values_table(COLUMNS, recorded.values, recorded.defined))
    write_tracks(folder.path / "seed.csv", job.scene)


def _describe(scene: SeedScene) -> dict[str, Any]:
    return {
        "name": scene.name,
        "location": scene.location,
        "time_s": scene.time_s,
        "vehicles": scene.vehicles,
        "track_ids": [int(t) for t in scene.track_ids],
        "obstacles": len(scene.obstacles.ids) if scene.obstacles is not None else 0,
        "recorded_future_steps": int(scene.future.shape[1]) if scene.future is not None else 0,
        "notes": list(scene.notes),
        "source": scene.source,
        "origin": list(scene.road.origin) if scene.road is not None else None,
        "fingerprint": fingerprint(scene),
    }


def _versions() -> dict[str, str]:
    names = ("libsumo", "eclipse-sumo", "lanelet2", "numpy", "scipy", "shapely", "pyarrow")
    return {"python": platform.python_version(), **{n: importlib.metadata.version(n) for n in names}}
