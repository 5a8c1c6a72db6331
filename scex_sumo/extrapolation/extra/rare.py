"""Rare collisions of a run: extra futures near them, chosen by simulations of pairs of vehicles."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.models.likely_draws import INATTENTIVE, WORDS, likely_scores
from scex_sumo.behaviors.models.likely_driver import LikelyDriver, LikelyProfile
from scex_sumo.evaluation.outcomes import encounters_of_rows
from scex_sumo.extrapolation.assignments import RARE_STREAM, child_generator, route_draws
from scex_sumo.extrapolation.extra.futures import ExtraFutures
from scex_sumo.extrapolation.extra.pair_simulation import PAIRS_AT_ONCE, simulated_gaps
from scex_sumo.extrapolation.job import VEHICLES_AT_ONCE, Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.rollout import history_at
from scex_sumo.extrapolation.situations import plans_of
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.results.parts import Parts
from scex_sumo.results.rare import FUTURES, FUTURES_SCHEMA, STATES, Rare, RarePair
from scex_sumo.scene import States, VehicleIndex
from scex_sumo.statistics.collision_search import sample_rare
from scex_sumo.statistics.importance import Outcomes, Sampled, joined

FREQUENT: Final = 10
"""Drawn futures with a collision from which on it is not rare, and no more futures are run."""

_LOOKS = np.arange(2, PLAN_STEPS, 3)  # steps of a first plan
_SHOWN = [1, 3, 6, 9]  # of these: after 0.6, 1.2, 2.1 and 3 s
_POSES = 3 * len(_LOOKS)  # values of a first plan; what its driver draws comes after them
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
    futures = _Futures(job, workers, extra, profile)
    found = sample_rare(
        futures,
        route_draws(range(len(job.assignment)), job.scene.vehicles, seed=job.settings.seed),
        outcomes,
        extra,
        draws_any=job.assignment[0] == 0,
        rng=child_generator(job.settings.seed, 0, RARE_STREAM),
    )
    return _described(found, profile, job, futures.keep(found))


class _Futures:
    """Extra futures whose vehicles have chosen numbers."""

    def __init__(self, job: Job, workers: Workers, extra: int, profile: LikelyProfile) -> None:
        self._profile = profile
        self.path = job.folder / FUTURES.parent
        # Another number of futures has other ones.
        self._extra = ExtraFutures(replace(job, on_paths=False), self.path / str(extra), workers)
        self._draw = np.zeros((len(job.assignment), job.scene.vehicles))
        self._job = job
        self._others: States | None = None

    def run(self, draw: FloatArray) -> Outcomes:
        """Run futures whose vehicles have numbers (N, V)."""
        self._draw = np.concatenate([self._draw, draw])
        assignment = np.broadcast_to(self._extra.job.assignment[:1], self._draw.shape)
        return joined([_outcomes(rows, *ends) for *ends, rows in self._extra.run(assignment, self._draw)])

    def first_plans(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        """Return centres and headings of first plans, and what drivers draw, (N, W, K) by numbers (N, W)."""
        size = max(1, VEHICLES_AT_ONCE // self._job.scene.vehicles)
        parts = [self._planned(vehicles, draw[at : at + size]) for at in range(0, len(draw), size)]
        return np.concatenate(parts)

    def _planned(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        job, count = self._job, len(draw)
        whole = np.full((count, job.scene.vehicles), 0.5)
        whole[:, vehicles] = draw
        history = history_at(job.scene, job.scene.history.repeat(count), np.arange(count), whole, step=0)
        child, column = (index.ravel() for index in np.indices(draw.shape))
        model = job.assignment[0][vehicles][column]
        groups = [
            VehicleIndex(child=child[model == k], vehicle=vehicles[column[model == k]])
            for k in range(len(job.models.built))
        ]
        rng = [child_generator(job.settings.seed, 0)] * count
        result = np.zeros((*draw.shape, _POSES + len(WORDS)))
        for k, made in plans_of(job.models.built, groups, history, job.road, rng):
            poses = np.stack([made.x, made.y, made.heading], axis=-1)[:, _LOOKS]
            result[child[model == k], column[model == k], :_POSES] = poses.reshape(-1, _POSES)
        likely = job.assignment[0][vehicles] == 0
        result[:, likely, _POSES:] = likely_scores(draw[:, likely].ravel(), self._profile).reshape(
            count, -1, len(WORDS)
        )
        return result

    def features(self, pair: tuple[int, int], plans: FloatArray) -> FloatArray:
        """Return the least gap of first plans (N, 2, K) up to some times, their poses then, and the draws."""
        scene, poses = self._job.scene, plans[:, :, :_POSES].reshape(len(plans), 2, len(_LOOKS), 3)
        one, other = np.moveaxis(poses, (1, 3), (0, 1))
        outlines = [
            Rectangles(
                x=x, y=y, heading=heading, half_length=scene.length[v] / 2, half_width=scene.width[v] / 2
            )
            for v, (x, y, heading) in zip(pair, (one, other), strict=True)
        ]
        gap = np.minimum.accumulate(separation(*outlines), axis=1)[:, _SHOWN]
        now = scene.history[:, -1]
        own = [
            part[:, _SHOWN]
            for v, (x, y, _) in zip(pair, (one, other), strict=True)
            for part in _turned(x - now.x[v], y - now.y[v], now.heading[v])
        ]
        return np.concatenate([gap, *own, plans[:, :, _POSES:].reshape(len(plans), -1)], axis=1)

    def pair_gaps(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        """Return the least gaps (n,) of pairs (n, 2) with numbers (n, 2) in plain futures, m."""
        if self._others is None:
            self._others = Parts(self._job.folder).read(0, len(self._job.assignment), plans=False).states
        size = max(1, PAIRS_AT_ONCE // self._job.scene.vehicles)
        parts = [
            simulated_gaps(self._job, self._others, vehicles[at : at + size], draw[at : at + size])
            for at in range(0, len(draw), size)
        ]
        return np.concatenate(parts)

    def keep(self, found: Sampled) -> float:
        """Write each future with a collision, the heaviest first, and drop all others.

        Returns:
            Expected severe injuries.
        """
        hit, ids = np.flatnonzero(found.hits()), self._job.scene.track_ids
        order = hit[np.argsort(-found.weight[hit], kind="stable")].tolist()
        rows = [self._hit(future) for future in order]
        for row, future in zip(rows, order, strict=True):
            k = found.chosen[future]
            row |= {
                "future": future,
                "weight": float(found.weight[future]),
                "chosen": None if k < 0 else ids[list(found.pairs[k])].tolist(),
                "draw": found.draw[future].tolist(),
            }
        parquet.write_table(
            pa.Table.from_pylist(rows, schema=FUTURES_SCHEMA), (self._job.folder / FUTURES).absolute()
        )
        for old in self.path.glob("[0-9]*"):
            shutil.rmtree(old, ignore_errors=True)
        return float(sum(row["weight"] * row["injuries"] for row in rows))

    def _hit(self, future: int) -> dict[str, Any]:
        """Return the first collision of a future, its injuries, and its states."""
        folder = self._job.folder if future < len(self._job.assignment) else self._extra.job.folder
        part = Parts(folder).read(future, future + 1, plans=False)
        assert part.collisions is not None
        hits, states = part.collisions.to_pylist(), part.states[0].swapaxes(0, 1)
        row = {name: hits[0][name] for name in ("time_s", "track_id", "other_id")}
        row["injuries"] = sum(hit[name] or 0.0 for hit in hits for name in ("p_mais3", "p_mais3_other"))
        return row | {name: getattr(states, name).ravel().tolist() for name in STATES}


def _turned(x: FloatArray, y: FloatArray, heading: float) -> tuple[FloatArray, FloatArray]:
    """Return ways along and across a heading."""
    cos, sin = np.cos(heading), np.sin(heading)
    return cos * x + sin * y, cos * y - sin * x


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


def _described(found: Sampled, profile: LikelyProfile, job: Job, injuries: float) -> Rare:
    track_ids, likely = job.scene.track_ids.tolist(), job.assignment[0] == 0
    share, hits = found.probability(), found.hits()
    pairs = []
    for pair in found.outcomes.pairs(collided=True):
        hit, own = found.hits(pair), found.probability(pair)
        if not hit.any():
            continue
        one, other = (track_ids[vehicle] for vehicle in pair)
        causes = [
            f"{track_ids[vehicle]} {cause}"
            for vehicle in sorted(pair, key=lambda vehicle: track_ids[vehicle])
            if likely[vehicle]
            for cause in _causes(likely_scores(found.draw[hit, vehicle], profile), found.weight[hit])
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
        chosen=int((found.chosen >= 0).sum()),
        simulated=found.simulated,
        expected_mais3=injuries,
        pairs=tuple(pairs),
    )


def _causes(scores: FloatArray, weight: FloatArray) -> list[str]:
    """Return in words what a driver draws much more often in futures with scores (n, K) than in all."""
    mean = weight @ scores / weight.sum()
    error = np.sqrt((weight**2).sum()) / weight.sum()
    sure = np.where(np.abs(mean) > max(_CAUSE, _SURE * error), mean, 0.0)
    causes = ["inattentive"] if sure[INATTENTIVE].max() > 0 else []
    sure[INATTENTIVE] = 0.0
    k = int(np.argmax(np.abs(sure)))
    if sure[k] and (words := WORDS[k][int(sure[k] > 0)]):
        causes.append(words)
    return causes
