"""Rare collisions of a run: extra futures with tilted draws of its drivers, beside the drawn ones."""

from __future__ import annotations

import shutil
from typing import Final

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.models.likely_draws import likely_variables
from scex_sumo.behaviors.models.likely_driver import LikelyDriver, LikelyProfile
from scex_sumo.evaluation.outcomes import encounters_of_rows
from scex_sumo.extrapolation.assignments import RARE_STREAM, child_generator, route_draws
from scex_sumo.extrapolation.extra.futures import ExtraFutures
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.results.rare import Rare, RarePair
from scex_sumo.statistics.importance import Outcomes, Sampled, joined, sample_rare
from scex_sumo.statistics.tilting import Variables

FREQUENT: Final = 10
"""Drawn futures with a collision from which on it is not rare, and no more futures are run."""

FOLDER: Final = "rare"
"""Folder of the extra futures, in that of the run."""

_CAUSE = 0.5  # mean score of the futures with a collision from which on it is named
_SURE = 3.5  # standard errors


def likely_profile(models: ModelSet) -> LikelyProfile | None:
    """Return the profile of the likely drivers of a run; None if other models are drawn, too."""
    if len(models.drawn) != 1:
        return None
    model = models.built[0].model if isinstance(models.built[0], Guarded) else models.built[0]
    return model.profile if isinstance(model, LikelyDriver) else None


def find_rare(job: Job, drawn: pa.Table, workers: Workers, extra: int) -> Rare | None:
    """Run extra futures, and return the probability of a collision; None if it is not rare.

    Args:
        job: of a finished run, whose models have a `likely_profile`.
        drawn: encounters of its futures, as `encounter_rows`.
        extra: number of futures.
    """
    profile = likely_profile(job.models)
    assert profile is not None
    outcomes = _outcomes(drawn, 0, len(job.assignment))
    if outcomes.hits().sum() >= FREQUENT:
        return None
    variables, futures = likely_variables(profile), _Futures(job, workers, extra)
    found = sample_rare(
        variables,
        futures.run,
        route_draws(range(len(job.assignment)), job.scene.vehicles, seed=job.settings.seed),
        outcomes,
        extra,
        tiltable=job.assignment[0] == 0,
        generator=lambda number: child_generator(job.settings.seed, number, RARE_STREAM),
    )
    futures.keep(found)
    return _described(found, variables, job)


class _Futures:
    """Extra futures whose vehicles have tilted numbers."""

    def __init__(self, job: Job, workers: Workers, extra: int) -> None:
        self.path = job.folder / FOLDER
        # Another number of futures has other ones.
        self._extra = ExtraFutures(job, self.path / str(extra), workers)
        self._draw = np.zeros((len(job.assignment), job.scene.vehicles))

    def run(self, draw: FloatArray) -> Outcomes:
        """Run futures whose vehicles have numbers (N, V)."""
        self._draw = np.concatenate([self._draw, draw])
        assignment = np.broadcast_to(self._extra.job.assignment[:1], self._draw.shape)
        return joined([_outcomes(rows, *ends) for *ends, rows in self._extra.run(assignment, self._draw)])

    def keep(self, found: Sampled) -> None:
        """Write weight, proposal and draws of each future with a collision, and drop all others."""
        hit = np.flatnonzero(found.outcomes.hits())
        pairs = [proposal.pair for proposal in found.proposals]
        ids = self._extra.job.scene.track_ids
        of = [found.proposal[future] for future in hit.tolist()]
        columns = {
            "future": pa.array(hit),
            "weight": pa.array(found.weight[hit]),
            "tilted": pa.array(
                [None if k < 0 else ids[list(pairs[k])].tolist() for k in of], pa.list_(pa.int64())
            ),
            "draw": pa.array(found.draw[hit].tolist(), pa.list_(pa.float64())),
        }
        parquet.write_table(pa.table(columns), (self.path / "futures.parquet").absolute())
        for old in self.path.glob("[0-9]*"):
            shutil.rmtree(old, ignore_errors=True)


def _outcomes(rows: pa.Table, first: int, stop: int) -> Outcomes:
    """Return the outcomes of children ``first`` to ``stop - 1``."""
    met = encounters_of_rows(rows)
    near = np.isfinite(met.gap) | met.collided
    return Outcomes(
        futures=stop - first,
        future=met.child[near] - first,
        first=np.minimum(met.first, met.second)[near],
        second=np.maximum(met.first, met.second)[near],
        gap=met.gap[near],
        collided=met.collided[near],
    )


def _described(found: Sampled, variables: Variables, job: Job) -> Rare:
    track_ids, likely = job.scene.track_ids.tolist(), job.assignment[0] == 0
    share, hits = found.probability(), found.outcomes.hits()
    pairs = []
    for pair in found.outcomes.pairs(collided=True):
        hit, own = found.outcomes.of(pair)[1], found.probability(pair)
        one, other = (track_ids[vehicle] for vehicle in pair)
        causes = [
            f"{track_ids[vehicle]} {cause}"
            for vehicle in sorted(pair, key=lambda vehicle: track_ids[vehicle])
            if likely[vehicle]
            for cause in _causes(variables, found.draw[hit, vehicle], found.weight[hit])
        ]
        pairs.append(
            RarePair(
                track_id=min(one, other),
                other_id=max(one, other),
                value=own.value,
                low=own.low,
                high=own.high,
                share=own.value / share.value,
                hits=int(hit.sum()),
                causes=tuple(causes),
            )
        )
    pairs.sort(key=lambda pair: (-pair.value, pair.track_id, pair.other_id))
    return Rare(
        **vars(share),
        hits=int(hits.sum()),
        tilted=int((found.proposal >= 0).sum()),
        pilot=found.pilot,
        weights=float(found.weight.sum()),
        weights_error=float(found.weight.std() * np.sqrt(len(found.weight))),
        pairs=tuple(pairs),
    )


def _causes(variables: Variables, draw: FloatArray, weight: FloatArray) -> list[str]:
    """Return in words what a driver draws much more often in futures (n,) with weights than in all."""
    mean = weight @ variables.scores(draw) / weight.sum()
    error = np.sqrt((weight**2).sum()) / weight.sum()
    sure = np.where(np.abs(mean) > max(_CAUSE, _SURE * error), mean, 0.0)
    away = list(variables.inattentive)
    causes = ["inattentive"] if away and sure[away].max() > 0 else []
    sure[away] = 0.0
    k = int(np.argmax(np.abs(sure)))
    if sure[k] and (words := variables.words[k][int(sure[k] > 0)]):
        causes.append(words)
    return causes
