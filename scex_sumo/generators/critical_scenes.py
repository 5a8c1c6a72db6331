"""Scores of generated scenes: critical encounters in a few short futures of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.progress import Progress
from scex_sumo.extrapolation.job import Job, run_in_memory
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.results.tables.encounters import answers_of
from scex_sumo.results.tables.outcomes import encounters_of_rows
from scex_sumo.scene import SeedScene

FUTURES: Final = 16
MODELS: Final = "rules"


def encounter_scores(
    scenes: Sequence[SeedScene], *, seed: int = 0, progress: Progress | None = None
) -> FloatArray:
    """Return the critical encounters (n,) in a future of each scene on one road, on average over 16 of 3 s.

    An encounter is critical by its TTC, PET, DRAC or a collision, as in ``rank``; `MODELS` drive.
    """
    road = scenes[0].road
    assert road is not None
    settings = RunSettings(models=MODELS, futures=FUTURES, world="plain", metrics="path", seed=seed)
    models, scores = ModelSet.of(settings), np.zeros(len(scenes))
    with TemporaryFolder() as folder:
        net = converted(road, Path(folder) / "map.net.xml")
        for k, scene in enumerate(scenes):
            if progress is not None:
                progress(k, len(scenes))
            drawn = models.draw(scene, futures=FUTURES, seed=seed)
            part = run_in_memory(Job(scene, net, settings, models, drawn, Path(folder)), range(FUTURES))
            assert part.encounters is not None
            scores[k] = answers_of(encounters_of_rows(part.encounters))["critical"].sum() / FUTURES
    return scores
