"""Case under test in a worker: its futures run within a time limit, and what is kept of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import OutOfTimeError, reason_of
from scex_sumo.behaviors.spec import ModelSpec
from scex_sumo.plug_in.time_limit import time_limit
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.moments.run import MomentTask, StudySettings, attempt, pack_road
from scex_sumo.studies.rank.stage import Stage, stage_of_motion
from scex_sumo.suites.simulate import Outcomes, by_level, chances, simulate
from scex_sumo.suites.situation import Situation, situation_of
from scex_sumo.suites.suite import Case

PEOPLE_TYPICAL: Final = 1e-3
"""P that people touch in a typical future: simulated others are not exact."""
EXACT_S: Final = 0.1
"""To which latest responses are known: futures have steps of 0.1 s."""
EXACT_M: Final = 0.1
"""To which gaps of critical responses are known: their stretches are those of tangents."""
_TYPICAL_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseTask(MomentTask):
    """Case to be run with a function.

    Attributes:
        initiator: track id; so ``responder``, which the function drives.
        seed: of the draws.
        limit_s: time of the case.
    """

    may_be_late: ClassVar[bool] = True

    initiator: int
    responder: int
    spec: ModelSpec
    seed: int
    limit_s: float


_packed = lru_cache(maxsize=4)(pack_road)


def task_of(case: Case, spec: ModelSpec, futures: int, *, seed: int, limit_s: float) -> CaseTask:
    """Return the task of a case; raise a `ResultError` if its files were changed."""
    content, scene = case.content, case.scene()
    assert scene.road is not None
    ref = MomentRef(
        moment=case.name,
        location=scene.location,
        recording=case.name,
        case="",
        time_s=0.0,
        vehicles=scene.vehicles,
    )
    return CaseTask(
        ref=ref,
        scene=dataclasses.replace(scene, road=None),
        road=_packed(scene.road),
        futures=range(futures),
        settings=StudySettings(),
        initiator=int(content["other"]["track_id"]),
        responder=int(content["function"]["track_id"]),
        spec=spec,
        seed=seed,
        limit_s=limit_s,
    )


def run_case(task: CaseTask, road: bytes | None = None) -> dict[str, Any] | Failure:
    """Return what came of a case, or why it failed."""
    try:
        with time_limit(f"a case of {task.spec}", task.limit_s):
            return attempt(_run, task, road)
    except OutOfTimeError as error:
        return Failure.of(task.ref, reason_of(error))


def _run(task: CaseTask, scene: SeedScene, road: bytes) -> dict[str, Any]:
    situation = situation_of(scene, task.initiator, task.responder)
    outcomes = simulate(situation, task.spec, len(task.futures), seed=task.seed)
    return record_of(situation, outcomes)


def record_of(situation: Situation, outcomes: Outcomes) -> dict[str, Any]:
    """Return what is kept of the futures of a case, fit for JSON."""
    draws, hit = outcomes.draws, outcomes.hit
    typical = draws.row < 0
    injuries = situation.injuries(outcomes.closing_mps) * hit
    harmed = by_level(situation, draws.weight * injuries, draws.row)
    share, acting = chances(situation, outcomes)
    stage = stage_of_future(situation, outcomes, worst_future(situation, outcomes))
    expected = expected_contacts(situation, outcomes)
    near = touch_and_go(situation, outcomes)
    return {
        "probability": 1 - (1 - share) * (1 - acting),
        "severity": float(injuries[typical].mean()) + situation.total(harmed),
        "typical": share,
        "acting": acting,
        "variance": share * (1 - share) / max(int(typical.sum()), 1),
        "futures": len(hit),
        "contacts": int(hit.sum()),
        "struck": int(outcomes.struck.sum()),
        "chance": chance(np.where(near, 1.0, expected), np.where(near, 0.0, expected), int(hit.sum())),
        "people_contacts": float(expected.sum()),
        "people": situation.human_like,
        "most": situation.most,
        "others": int(np.isfinite(outcomes.other_s).sum()),
        "gap_m": _median(outcomes.gap_m),
        "ttc_s": _median(outcomes.ttc_s),
        "drac_mps2": float(np.median(outcomes.drac_mps2)),
        "braking_mps2": float(np.median(outcomes.braking_mps2)),
        "jerk_mps3": float(np.median(outcomes.jerk_mps3)),
        "hardest_mps2": max(0.0, float(outcomes.braking_mps2.max())),
        "picture": str(stage.picture),
        "outlines": stage.outlines,
        "contact": stage.contact,
    }


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def expected_contacts(situation: Situation, outcomes: Outcomes) -> FloatArray:
    """Return the probability (C,) with which people touch in each future."""
    draws = outcomes.draws
    row = np.maximum(draws.row, 0)
    wide = draws.high - draws.low
    exact = wide < 1  # people, with a deceleration of their own
    late = np.where(exact, situation.late_by[row, draws.braking], situation.late.ravel()[row])
    part = np.clip((late - draws.low) / np.maximum(wide, 1e-12), 0.0, 1.0)
    part = np.where(wide > 0, part, outcomes.hit)  # nobody responds so: its weight is 0
    return np.where(draws.row < 0, PEOPLE_TYPICAL, part)


def touch_and_go(situation: Situation, outcomes: Outcomes) -> BoolArray:
    """Return in which futures (C,) of people either may happen: near the latest response, or a graze."""
    draws = outcomes.draws
    latest = situation.critical_by[np.maximum(draws.row, 0), draws.braking]
    with np.errstate(invalid="ignore"):
        near = np.abs(draws.response_s - latest) <= EXACT_S
    near |= ~outcomes.hit & (outcomes.gap_m < EXACT_M)
    return np.asarray(near & (draws.row >= 0) & (draws.high - draws.low < 1))


def chance(most: FloatArray, least: FloatArray, contacts: int) -> Mapping[str, float]:
    """Return the one-sided probabilities that people touch in at least, and at most, so many futures.

    Args:
        most: (C,) probabilities, at most; ``least`` at least. Their sums are Poisson binomial.
    """
    return {
        "more": float(min(_counts(most)[contacts:].sum(), 1.0)),
        "fewer": float(min(_counts(least)[: contacts + 1].sum(), 1.0)),
    }


def _counts(expected: FloatArray) -> FloatArray:
    counts = np.ones(1)
    for p in expected.tolist():
        counts = np.convolve(counts, [1 - p, p])
    return counts


def worst_future(situation: Situation, outcomes: Outcomes) -> int:
    """Return the future that is shown: the most frequent with a contact, else that with the least gap."""
    row = np.maximum(outcomes.draws.row, 0)
    often = np.where(outcomes.draws.row < 0, 1.0, situation.often.ravel()[row])
    if outcomes.hit.any():
        return int(np.argmax(np.where(outcomes.hit, often, -1.0)))
    return int(np.argmin(np.where(outcomes.draws.row >= 0, outcomes.gap_m, np.inf)))


def stage_of_future(situation: Situation, outcomes: Outcomes, future: int) -> Stage:
    """Return the playing picture of a future: the two, and the others around them."""
    end = outcomes.contact_s[future]
    stop = 2 + int(np.ceil(end / 0.1)) if np.isfinite(end) else 1 + _TYPICAL_STEPS
    states = outcomes.states[future][:, :stop]
    both = [situation.initiator, situation.responder]
    whole = type(states).concatenate([situation.scene.history[:, :-1], states], axis=1)
    known = np.ones(whole.shape, dtype=np.bool_)
    known[both] = False
    return stage_of_motion(situation.scene, (both[0], both[1]), states[both], whole, known)
