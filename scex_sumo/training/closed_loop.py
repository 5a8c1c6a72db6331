"""Closed loop without SUMO: driving, and what a driver should have done from where it drifted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.behaviors.base import Behavior
from scex_sumo.extrapolation.rollout import Cast, roll_out
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.training.data.perturb import Perturbation, perturbed
from scex_sumo.training.data.samples import Samples, scene_samples
from scex_sumo.world.plain import PlainWorld

REPLAN = 5
DRIFT_STEPS = (5, 10, 20)  # after so much driving by itself a driver is asked what it should have done


def drive_all(
    scene: SeedScene, road: Road, model: Behavior, *, steps: int, children: int = 1, replan: int = REPLAN
) -> States:
    """Let one model drive all vehicles of a seed scene.

    Returns:
        (C, steps, V) states after each step.
    """
    rng = np.random.default_rng(0)
    cast = Cast(
        children=np.arange(children),
        assignment=np.zeros((children, scene.vehicles), dtype=np.int64),
        models=(model,),
        names=("driver",),
        overridden=np.array([True]),
        route_draw=rng.random((children, scene.vehicles)),
        generators=[np.random.default_rng([0, child]) for child in range(children)],
    )
    world = PlainWorld(children, scene.vehicles)
    return roll_out(world, road, scene, cast, steps=steps, replan=replan).states


def drifted_samples(
    scenes: Sequence[tuple[SeedScene, Road, int]],
    model: Behavior,
    perturbation: Perturbation,
    rng: np.random.Generator,
    tick: Callable[[int, int], None] | None = None,
) -> Samples | None:
    """Where a driver gets to by itself, with the way back to what the recorded ones did as its target.

    Args:
        scenes: seed scene, map and number of the site.
        model: drives all vehicles.
        perturbation: of the starts.
        rng: for it.
        tick: called with the number of scenes done, and of all.
    """
    found = []
    for done, (scene, road, site) in enumerate(scenes):
        start = replace(scene, history=perturbed(scene.history, perturbation, rng))
        driven = drive_all(start, road, model, steps=max(DRIFT_STEPS)).swapaxes(1, 2)
        whole = States.concatenate([start.history.repeat(1), driven], 2)
        for step in DRIFT_STEPS:
            window = whole[:, :, step : step + HISTORY_STEPS + 1]
            samples = scene_samples(start, road, window, site=site, step=step)
            found += [samples] if samples is not None else []
        if tick is not None:
            tick(done + 1, len(scenes))
    return Samples.concatenate(found) if found else None
