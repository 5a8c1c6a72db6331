"""Closed loop without SUMO: what a driver should have done from where it drifts to when it drives itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.learned.models import GraphImagePredictor, GraphPredictor
from scex_sumo.behaviors.learned.profiles import GraphImagePredictorProfile, GraphPredictorProfile
from scex_sumo.converters.datasets.recordings import Recording, load_recording
from scex_sumo.extrapolation.rollout import Cast, roll_out
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.training.data.dataset import SampleOptions, part_scenes
from scex_sumo.training.data.perturb import Perturbation, perturbed
from scex_sumo.training.data.samples import TrainingSamples, scene_samples
from scex_sumo.world.plain import PlainWorld

if TYPE_CHECKING:
    from scex_sumo.training.options import TrainOptions
    from scex_sumo.training.train import Drift

REPLAN = 5
DRIFT_STEPS = (5, 10, 20)  # after so much driving by itself a driver is asked what it should have done
MOST_SCENES = 30  # of a site and round
EVERY_S = 1.0


def closed_loop(
    recordings: Sequence[Recording], sampling: SampleOptions, sites: Sequence[str], options: TrainOptions
) -> Drift:
    """What makes the samples of a round: the network drives all vehicles of training scenes.

    Args:
        sampling: their split and perturbations.
        sites: names of the sites by number.
    """

    def drift(file: Path, number: int) -> TrainingSamples | None:
        rng = np.random.default_rng([options.seed, number, 1])
        scenes: list[tuple[SeedScene, Road, int]] = []
        for index, site in enumerate(sites):
            here: list[SeedScene] = []
            for recording in recordings:
                if recording.site == site:
                    loaded = load_recording(recording)
                    here += part_scenes(loaded, "train", split=sampling.split, every_s=EVERY_S)
            chosen = rng.permutation(len(here))[:MOST_SCENES]
            road = here[0].road if here else None
            if road is not None:
                scenes += [(here[k], road, index) for k in sorted(chosen.tolist())]
        return drifted_samples(scenes, driver(options.kind, file), sampling.perturbation, rng)

    return drift


def driver(kind: str, file: Path) -> Behavior:
    """The behaviour model that drives with a file of weights, on its likeliest path."""
    if kind == "graph":
        return GraphPredictor(GraphPredictorProfile(path="likeliest", weights=str(file)))
    return GraphImagePredictor(GraphImagePredictorProfile(path="likeliest", weights=str(file)))


def drifted_samples(
    scenes: Sequence[tuple[SeedScene, Road, int]],
    model: Behavior,
    perturbation: Perturbation,
    rng: np.random.Generator,
) -> TrainingSamples | None:
    """Where a driver gets to by itself, with the way back to what the recorded ones did as its target.

    Args:
        scenes: seed scene, map and number of the site.
    """
    found = []
    for scene, road, site in scenes:
        start = replace(scene, history=perturbed(scene.history, perturbation, rng))
        driven = drive_all(start, road, model, steps=max(DRIFT_STEPS)).swapaxes(1, 2)
        whole = States.concatenate([start.history.repeat(1), driven], 2)
        for step in DRIFT_STEPS:
            window = whole[:, :, step : step + HISTORY_STEPS + 1]
            samples = scene_samples(start, road, window, site=site, step=step)
            found += [samples] if samples is not None else []
    return TrainingSamples.concatenate(found) if found else None


def drive_all(scene: SeedScene, road: Road, model: Behavior, *, steps: int) -> States:
    """Let one model drive all vehicles of a seed scene; (1, steps, V) states after each step."""
    cast = Cast(
        children=np.zeros(1, dtype=np.int64),
        assignment=np.zeros((1, scene.vehicles), dtype=np.int64),
        models=(model,),
        names=("driver",),
        overridden=np.array([True]),
        route_draw=np.random.default_rng(0).random((1, scene.vehicles)),
        generators=[np.random.default_rng([0, 0])],
    )
    return roll_out(PlainWorld(1, scene.vehicles), road, scene, cast, steps=steps, replan=REPLAN).states
