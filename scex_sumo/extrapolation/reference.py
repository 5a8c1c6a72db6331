"""Reference of a run: the same seed scene with human-like drivers."""

from __future__ import annotations

import dataclasses
import shutil

from scex_sumo.extrapolation.engine import DEFAULT_OPTIONS, RunOptions, run_scene
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.scene import SeedScene
from scex_sumo.world.base import WORLDS

CHILDREN = 117
"""A share then has a 95 % interval of at most +-9 %."""
STEPS = 30
"""Up to so many steps, a reference has all `CHILDREN`, however few the run has."""
RARE_PART = 5
"""Of this many futures, one more is run for rare collisions."""


def add_reference(
    run: Run,
    scene: SeedScene,
    models: Models,
    settings: RunSettings,
    *,
    workers: Workers,
    options: RunOptions = DEFAULT_OPTIONS,
    rare: int | None = None,
) -> Run:
    """Run the reference of a run into its folder ``reference/``; a finished one is kept.

    Args:
        models: human-like ones, drawn for all vehicles.
        settings: of the run.
        rare: number of extra futures for rare collisions, see `Run.rare`; None: a fifth of all others.
    """
    children = reference_children(run.children, settings.steps)
    extra = (run.children + children) // RARE_PART if rare is None else rare
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
    quiet = dataclasses.replace(options, batch=None, gui=False, rare=extra)
    folder = run.folder / REFERENCE
    return run_scene(scene, wanted, out=folder, workers=workers, overwrite=True, options=quiet)


def reference_children(children: int, steps: int) -> int:
    """Return the number of children of the reference of a run.

    There are fewer than `CHILDREN` if they would cost more than the run and than `STEPS` steps of all.
    """
    return min(CHILDREN, max(children, CHILDREN * STEPS // steps))


def drop_reference(run: Run) -> None:
    """Remove the reference of an earlier run from a result folder."""
    shutil.rmtree(run.folder / REFERENCE, ignore_errors=True)
