"""Driving without SUMO: a world of arrays, and what a driver should have done from where it drifted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.extrapolation.rollout import Cast, roll_out
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.training.data.perturb import Perturbation, perturbed
from scex_sumo.training.data.samples import Samples, scene_samples

REPLAN = 5
DRIFT_STEPS = (5, 10, 20)  # after so much driving by itself a driver is asked what it should have done


class PlainWorld:
    """A world that does as it is told: what libsumo holds after a step too, where all are overridden."""

    def __init__(self, children: int, vehicles: int) -> None:
        self._states = States.empty((children, vehicles))

    def move(self, states: States, mask: BoolArray) -> None:
        """Override the masked vehicles' next states, (C, V)."""
        self._states = states.map(lambda values: np.where(mask, values, np.nan))

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Obstacles are read from the seed scene."""

    def step(self) -> None:
        """Nothing is left to do."""

    def read(self) -> States:
        """(C, V) what was told."""
        return self._states


def drive_all(
    seed: SeedScene, road: Road, model: Behavior, *, steps: int, children: int = 1, replan: int = REPLAN
) -> States:
    """Let one model drive all vehicles of a seed scene.

    Returns:
        (C, steps, V) states after each step.
    """
    rng = np.random.default_rng(0)
    cast = Cast(
        children=np.arange(children),
        assignment=np.zeros((children, seed.vehicles), dtype=np.int64),
        models=(model,),
        names=("driver",),
        overridden=np.array([True]),
        route_draw=rng.random((children, seed.vehicles)),
        generators=[np.random.default_rng([0, child]) for child in range(children)],
    )
    world = PlainWorld(children, seed.vehicles)
    return roll_out(world, road, seed, cast, steps=steps, replan=replan).states


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
