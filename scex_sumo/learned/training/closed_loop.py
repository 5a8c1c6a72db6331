"""Closed loop without SUMO: samples from places to which a driver drifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.converters.registries import Recording
from scex_sumo.drivers.registry import ModelSpec, build
from scex_sumo.extrapolation.loop.rollout import Batch, roll_out
from scex_sumo.learned.network.weights import MODELS
from scex_sumo.learned.training.data.dataset import (
    Dataset,
    SampleOptions,
    loaded_sites,
    map_shift,
    part_scenes,
)
from scex_sumo.learned.training.data.perturb import add_obstacles, perturbed
from scex_sumo.learned.training.data.samples import TrainingSamples, learnable, scene_samples
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.world.plain import PlainWorld

if TYPE_CHECKING:
    from scex_sumo.learned.training.train import Drift, TrainOptions

REPLAN = 5
DRIFT_STEPS = (5, 10, 20)  # that a driver drives before a sample is made
MAX_SCENES = 10  # of a site and round
EVERY_S, MOMENTS = 1.0, 400  # between moments, of which they are drawn; most moments of a site


def closed_loop(
    recordings: Sequence[Recording], sampling: SampleOptions, dataset: Dataset, options: TrainOptions
) -> Drift:
    """Return the function that makes the samples of a round."""

    def drift(file: Path, number: int) -> TrainingSamples | None:
        # The plan of `joint` is what it drives in closed loop.
        replan = PLAN_STEPS if options.kind == "joint" else REPLAN
        rng, drifted = np.random.default_rng([options.seed, number, 1]), list[TrainingSamples]()
        spec = ModelSpec(name=MODELS[options.kind], parameters={"path": "likeliest", "weights": str(file)})
        model = build(spec)
        for index, (_, loaded, apart_s) in enumerate(loaded_sites(recordings, MOMENTS)):
            every_s = max(EVERY_S, apart_s)
            scenes: list[SeedScene] = []
            for recording in loaded:
                scenes += part_scenes(recording, "train", split=sampling.split, every_s=every_s)
            for k in sorted(rng.permutation(len(scenes))[:MAX_SCENES].tolist()):
                road = scenes[k].road
                assert road is not None
                shift = map_shift(dataset.roads[index], road)
                for samples in drifted_samples(scenes[k], road, model, rng, replan):
                    drifted.append(samples.at(index, shift))
        return TrainingSamples.concatenate(drifted) if drifted else None

    return drift


def drifted_samples(
    scene: SeedScene, road: Road, model: BatchBehavior, rng: np.random.Generator, replan: int
) -> list[TrainingSamples]:
    """Make samples where a driver drifts to; targets are the way back, or a stop behind standing vehicles."""
    off = replace(scene, history=perturbed(scene.history, rng))
    stop = add_obstacles(scene, road, learnable(scene, max(DRIFT_STEPS)), rng)
    drifted = []
    for start, blocked in [(off, None), *([] if stop is None else [stop])]:
        driven = _drive_all(start, road, model, start.vehicles - scene.vehicles, replan)
        states = States.concatenate([start.history.repeat(1), driven.swapaxes(1, 2)], 2)
        for step in DRIFT_STEPS:
            window = states[:, :, step : step + HISTORY_STEPS + 1]
            samples = scene_samples(start, road, window, blocked=blocked, step=step)
            drifted += [samples] if samples is not None else []
    return drifted


def _drive_all(scene: SeedScene, road: Road, model: BatchBehavior, held: int, replan: int) -> States:
    """Let one model drive all vehicles, (1, steps, V); the last ``held`` ones keep their velocity."""
    mine = (np.arange(scene.vehicles) >= scene.vehicles - held).astype(np.int64)
    batch = Batch(
        futures=np.zeros(1, dtype=np.int64),
        assignment=mine[None],
        models=(model, build(ModelSpec(name="constant_velocity"))),
        names=("driver", "constant_velocity"),
        overridden=np.array([True, True]),
        route_draw=np.random.default_rng(0).random((1, scene.vehicles)),
        generators=[np.random.default_rng([0, 0])],
    )
    world, steps = PlainWorld(1, scene.vehicles), max(DRIFT_STEPS)
    return roll_out(world, road, scene, batch, steps=steps, replan=replan, crash=False).states
