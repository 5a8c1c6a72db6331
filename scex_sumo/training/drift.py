"""The rounds in closed loop of a training run: which scenes are driven, and by what."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.learned.models import GraphImagePredictor, GraphPredictor
from scex_sumo.behaviors.learned.profiles import GraphImagePredictorProfile, GraphPredictorProfile
from scex_sumo.converters.datasets.recordings import Recording, load_recording
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from scex_sumo.training.closed_loop import drifted_samples
from scex_sumo.training.data.dataset import SampleOptions, part_scenes
from scex_sumo.training.data.samples import Samples
from scex_sumo.training.options import TrainOptions
from scex_sumo.training.train import Drift

MOST_SCENES = 30  # of a site and round
EVERY_S = 1.0


def closed_loop(
    recordings: Sequence[Recording], sampling: SampleOptions, sites: Sequence[str], options: TrainOptions
) -> Drift:
    """What makes the samples of a round: the network drives all vehicles of training scenes.

    Args:
        recordings: of the training.
        sampling: their split and perturbations.
        sites: names of the sites by number.
        options: of the training.
    """

    def drift(file: Path, number: int) -> Samples | None:
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


def driver(kind: str, file: Path, *, attention: float = 0.5) -> Behavior:
    """The behaviour model that drives with a file of weights, on its likeliest path."""
    if kind == "graph":
        return GraphPredictor(GraphPredictorProfile(path="likeliest", weights=str(file)))
    profile = GraphImagePredictorProfile(path="likeliest", weights=str(file), attention=attention)
    return GraphImagePredictor(profile)
