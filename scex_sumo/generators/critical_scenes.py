"""Choice of generated scenes: distinct and critical ones, by encounters in a few short futures of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
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


PLAIN_SHARE: Final = 0.2
"""Share of the draws that the scores do not decide."""


def sample_by_score(score: FloatArray, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Draw candidates by their scores, each at most once, with weights that keep shares.

    The scores decide on 80 % of the draws, so no weight is far above 5 / ``count``.

    Args:
        score: (N,) from 0; only ratios matter, and scores of 0 alone give equal chances.
        count: at most N.

    Returns:
        (count,) candidates, ascending, and their weights. These sum to 1; the weighted share of a property
        estimates its share among all candidates.

    Source: Madow 1949 (systematic sampling by size), Hájek 1971 (weights).
    """
    share = np.full(len(score), 1 / len(score))
    if score.sum() > 0:
        share = PLAIN_SHARE * share + (1 - PLAIN_SHARE) * score / score.sum()
    drawn, chance = drawn_by_size(share, count, rng)
    return drawn, 1 / chance / (1 / chance).sum()


def drawn_by_size(size: FloatArray, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Draw ``count`` candidates, ascending, with chances min(1, factor x size); return both."""
    if not count:
        return np.empty(0, dtype=np.int64), np.empty(0)
    certain, factor = np.zeros(len(size), dtype=np.bool_), np.inf
    while not certain.all():
        factor = (count - certain.sum()) / max(float(size[~certain].sum()), 1e-300)
        above = ~certain & (size * factor >= 1)
        if not above.any():
            break
        certain |= above
    chance = np.where(certain, 1.0, np.minimum(size * min(factor, 1e300), 1.0))
    order = np.lexsort((rng.random(len(size)), size))  # so that weights add up almost the same in each draw
    ends = np.cumsum(chance[order])
    at = np.searchsorted(ends, (rng.random() + np.arange(count)) * ends[-1] / count, side="right")
    drawn = np.sort(order[np.minimum(at, len(size) - 1)])
    return drawn, chance[drawn]
