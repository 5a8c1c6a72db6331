"""Case under test in a worker: its futures run within a time limit, and what is kept of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.spec import ModelSpec
from scex_sumo.decision.decide import RARE
from scex_sumo.plug_in.time_limit import time_limit
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.moments.run import MomentTask, StudySettings, pack_road
from scex_sumo.suites.case import shown
from scex_sumo.suites.drive import Driven, drive
from scex_sumo.suites.suite import Case


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseTask(MomentTask):
    """Case to be run with a function.

    Attributes:
        track_id: of the vehicle that the function drives; ``other_id`` of the other one.
        seed: of the draws.
        limit_s: time of the case.
    """

    may_be_late: ClassVar[bool] = True

    track_id: int
    other_id: int
    spec: ModelSpec
    futures: int
    seed: int
    limit_s: float


_packed = lru_cache(maxsize=4)(pack_road)


def task_of(case: Case, spec: ModelSpec, futures: int, *, limit_s: float) -> CaseTask:
    """Return the task of a case; raise a `ResultError` if its files were changed."""
    content, scene = case.content, case.scene()
    name, location = case.name, scene.location
    assert scene.road is not None
    return CaseTask(
        ref=MomentRef(
            moment=name, location=location, recording=name, case="", time_s=0.0, vehicles=scene.vehicles
        ),
        scene=dataclasses.replace(scene, road=None),
        road=_packed(scene.road),
        futures=futures,
        settings=StudySettings(),
        track_id=int(content["function"]["track_id"]),
        other_id=int(content["other"]["track_id"]),
        spec=spec,
        seed=int(content["drivers"]["seed"]),
        limit_s=limit_s,
    )


def run_case(task: CaseTask, scene: SeedScene) -> dict[str, Any]:
    """Return what came of a case."""
    count = task.futures
    with time_limit(f"a case of {task.spec}", task.limit_s):
        function = drive(scene, task.track_id, task.spec, count, seed=task.seed)
        people = drive(scene, task.track_id, None, count, seed=task.seed)
        return record_of(function, people, task.other_id)


def record_of(function: Driven, people: Driven, other_id: int) -> dict[str, Any]:
    """Return what is kept of the futures of a case with the function, and with people; fit for JSON.

    ``pair`` and ``people_pair`` are P of a contact with the other one of the case alone.
    """
    told = function.pairs[0] if function.pairs else function.row_of(other_id)
    pair, people_pair = function.contacts_with(other_id), people.contacts_with(other_id)
    return {
        "probability": function.any.probability,
        "people": people.any.probability,
        "p_alone": p_alone(function, people),
        "pair": pair.probability,
        "people_pair": people_pair.probability,
        "variance": _variance(pair.effects),
        "people_variance": _variance(people_pair.effects),
        "difference_variance": _variance(pair.effects - people_pair.effects),
        "futures": function.futures,
        "collide": float(function.collides.mean()),
        "people_collide": float(people.collides.mean()),
        **{name: told[name] for name in ("how", "future", "needed_braking", "time_margin", "gap_m")},
        **shown(function, told),
    }


def _variance(effects: FloatArray) -> float:
    return float(effects.var(ddof=1) / len(effects))


def p_alone(function: Driven, people: Driven) -> float | None:
    """Return the two-sided p of a function that is like people in a case; None if they are the same.

    The more telling of two tests decides: a paired t-test (Student 1908) of the cube roots of P, and a count
    of the collisions against that by people's P, at least `RARE` in each future, after Poisson.
    """
    from scipy.special import pdtrc, stdtr

    differences, count = function.any.root - people.any.root, function.futures
    spread = float(differences.std(ddof=1))
    if spread == 0:
        return 0.0 if differences.any() else None
    by_roots = float(stdtr(count - 1, -abs(differences.mean()) / spread * np.sqrt(count)))
    hits = int(function.collides.sum())
    by_hits = float(pdtrc(hits - 1, np.maximum(people.any.each, RARE).sum())) if hits else 1.0
    return min(1.0, 4 * min(by_roots, by_hits))
