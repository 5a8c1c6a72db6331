"""Extrapolation of a seed scene in Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from scex_sumo.base.errors import warn_notes
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.engine import RunOptions, run_scene
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.metrics.registry import Metric
from scex_sumo.results.region import EVERYWHERE, Region
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.designs import DEFAULT_DESIGN
from scex_sumo.world.base import DEFAULT_WORLD


def extrapolate(
    scene: SeedScene,
    *,
    models: Models = DEFAULT_MODELS,
    assign: Mapping[int, str] | None = None,
    under_test: Mapping[int, str | None] | None = None,
    baseline: bool = True,
    children: int | str = 385,
    design: str = DEFAULT_DESIGN,
    until_band: float | None = None,
    steps: int = 30,
    replan: int = 5,
    seed: int = 0,
    world: str = DEFAULT_WORLD,
    preset: str = "both",
    metrics: Sequence[str | Metric] | None = None,
    thresholds: Mapping[str, float] | None = None,
    reflect: bool = True,
    keep_plans: bool = False,
    region: Region = EVERYWHERE,
    out: str | Path | None = None,
    overwrite: bool = False,
    workers: int = 1,
    batch: int | None = None,
    gui: bool = False,
    cache: bool = True,
    exact: bool = True,
    progress: Progress | bool | None = None,
    command: Sequence[str] | None = None,
) -> Run:
    """Simulate many child scenarios of a seed scene with different drivers, and measure each.

    `scex_sumo.extrapolation.settings.RunSettings` describes the arguments up to ``region``; the others
    change no value. Notes on net and run are `ScexWarning`.

    Args:
        scene: the seed scene, with its road.
        out: result folder; None makes a temporary one that lives as long as the run.
        overwrite: replace the result of another run in ``out``.
        workers: processes that share the children.
        batch: children side by side in one world; None for about 6000 vehicles.
        gui: show the run live in sumo-gui.
        cache: keep net, map features and assignments in ``~/.cache/scex-sumo``.
        exact: run more futures for exact probabilities if all models are deterministic, see `Run.exact`.
        progress: True for a bar on a terminal or in a notebook; or called with (steps done, steps in all).
        command: the command line, for ``run.json``.

    Raises:
        UsageError: an argument makes no sense.
        ResultError: the folder cannot be written, or holds another run.
        ScexError: any other fault of the input or the environment.

    Example:
        >>> run = scex.extrapolate(scene, children=4, models="standard_driver,emergency_brake", seed=1)
        >>> run.metrics.num_rows
        4
    """
    settings = RunSettings(
        models=models,
        assign=assign or {},
        under_test=under_test or {},
        baseline=baseline,
        children=children,
        design=design,
        until_band=until_band,
        steps=steps,
        replan=replan,
        seed=seed,
        world=world,
        preset=preset,
        metrics=metrics,
        thresholds=thresholds or {},
        reflect=reflect,
        keep_plans=keep_plans,
        region=region,
    )
    with (
        progress_of(progress, scene.name) as tick,
        Workers(1 if gui else min(workers, settings.count or workers)) as pool,
    ):
        options = RunOptions(batch=batch, gui=gui, cache=cache, exact=exact, progress=tick, command=command)
        run = run_scene(scene, settings, out=out, overwrite=overwrite, workers=pool, options=options)
    warn_notes([*run.info["net_notes"], *run.info["run_notes"]])
    return run
