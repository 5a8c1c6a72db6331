"""Risk of a moment of a running simulation: human-like and stress P of a collision of each pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.decision.moment import human_part, pairs_of_part
from scex_sumo.drivers.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.job import ruled, run_in_memory
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.geometry.rectangles import BOX, outlines
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.live.moment import Moment
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.results.tables.pairs import any_of, ends
from scex_sumo.scene import SeedScene

FUTURES: Final = 64
LEAST: Final = 1e-9
"""P from which a pair counts."""
_GHOST_STEPS: Final = 5  # between two outlines
_MIN_VEHICLES: Final = 2  # vehicles that can collide


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is asked of each moment: futures (0: none) and models of the stress test.

    A `UsageError` if models are unknown.
    """

    futures: int = FUTURES
    models: str = DEFAULT_MODELS
    seed: int = 0

    def __post_init__(self) -> None:
        if self.futures < 0:
            raise UsageError(f"--futures: got {self.futures}, needs 0 or more")
        _models(self)


@dataclass(frozen=True, kw_only=True)
class PairRisk:
    """Risk of two vehicles, by SUMO's names.

    Attributes:
        hits: the vehicle that hits or follows.
        kind: of the conflict, see `scex_sumo.decision.words.WHAT`, or of the collision of the stress test.
        human_like: P of a contact between people; 0 below `LEAST`.
        stress: share of the futures of the stress test in which the two collide first; None without one.
        how: it comes to it, in words.
        needed_braking: in the human-like future that decides, m/s²; None if there is none.
        contact_s: time of the conflict from the moment on, s.
        doubt: why the data are doubtful; None if they are not.
        x: of the vehicle that hits, m, at the moment; so ``y``.
    """

    hits: str
    other: str
    kind: str
    human_like: float
    stress: float | None
    how: str = ""
    needed_braking: float | None = None
    contact_s: float | None = None
    doubt: str | None = None
    x: float = 0.0
    y: float = 0.0

    @property
    def names(self) -> tuple[str, str]:
        """Both names, in the order of the arrow."""
        return self.hits, self.other

    @property
    def combined(self) -> float:
        """P that they collide as people or as in the stress test, as if independent, see docs/live.md."""
        return any_of((self.human_like, self.stress or 0.0))


@dataclass(frozen=True, kw_only=True)
class Risk:
    """Risk of a moment.

    Attributes:
        time_s: of the simulation.
        pairs: the most probable one of people first, pairs with doubtful data last.
        vehicles: SUMO's names.
        ghosts: outlines (T, 5, 2) of vehicles in the typical future in which the first pair collides, else
            comes nearest; by name, m.
    """

    time_s: float
    pairs: tuple[PairRisk, ...]
    vehicles: tuple[str, ...]
    ghosts: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def worst(self) -> PairRisk | None:
        """The pair that leads: the first one without doubt."""
        return next((pair for pair in self.pairs if pair.doubt is None), None)

    def of(self, name: str) -> float:
        """Return the human-like P that a vehicle collides with any other one."""
        return any_of(p.human_like for p in self.pairs if name in p.names and p.doubt is None)


def assess(moment: Moment, question: Question) -> Risk:
    """Return the risk of a moment, in this process; raise a `ScexError` without a vehicle or a net."""
    scene = moment.scene()
    names = {int(track): name for track, name in scene.source["vehicles"].items()}
    settings, models = _models(question)
    assert scene.road is not None
    with TemporaryFolder() as folder:
        scene, net = ruled(scene, converted(scene.road, Path(folder) / "net.net.xml"), settings)
        people = pairs_of_part(scene, human_part(scene, net, seed=question.seed)).to_pylist()
        stress_test = None
        if question.futures and scene.vehicles >= _MIN_VEHICLES:
            stress_test = run_in_memory(scene, net, settings, models, on_paths=False)
    pairs = _pairs(scene, names, people, stress_test)
    pairs = [pair for pair in pairs if moment.counts(pair.names)]
    pairs.sort(key=lambda pair: (pair.doubt is not None, -pair.human_like, -(pair.stress or 0.0)))
    risk = Risk(time_s=scene.time_s, pairs=tuple(pairs), vehicles=tuple(names.values()))
    ghosts = _ghosts(scene, names, risk.worst, stress_test)
    return replace(risk, ghosts=ghosts)


def _pairs(
    scene: SeedScene, names: Mapping[int, str], people: Sequence[Mapping[str, Any]], stress_test: Part | None
) -> list[PairRisk]:
    stress = {} if stress_test is None else _stress(stress_test)
    xy = zip(scene.now.x.tolist(), scene.now.y.tolist(), strict=True)
    place = dict(zip(scene.track_ids.tolist(), xy, strict=True))
    pairs = []
    for pair in people:
        key = frozenset((pair["track_id"], pair["other_id"]))
        if pair["probability"] < LEAST and key not in stress:
            continue
        hits, other = ends(pair)
        x, y = place[pair["track_id"]]
        pairs.append(
            PairRisk(
                hits=hits,
                other=other,
                kind=pair["what"],
                human_like=pair["probability"] if pair["probability"] >= LEAST else 0.0,
                stress=None if stress_test is None else stress.pop(key, {"share": 0.0})["share"],
                how=pair["how"] or "",
                needed_braking=pair["needed_braking"] or None,
                contact_s=pair["conflict_s"],
                doubt=pair["doubt"],
                x=x,
                y=y,
            )
        )
    for collision in stress.values():  # people do not collide in these
        x, y = place[collision["track_id"]]
        pairs.append(
            PairRisk(
                hits=names[collision["track_id"]],
                other=names[collision["other_id"]],
                kind=collision["kind"],
                human_like=0.0,
                stress=collision["share"],
                contact_s=collision["time_s"],
                x=x,
                y=y,
            )
        )
    return pairs


def _stress(stress_test: Part) -> dict[frozenset[int], dict[str, Any]]:
    """Return by pair its first collision, with the ``share`` of futures in which the two collide first."""
    stress: dict[frozenset[int], dict[str, Any]] = {}
    assert stress_test.collisions is not None
    for collision in first_contacts(stress_test.collisions).to_pylist():
        key = frozenset((collision["track_id"], collision["other_id"]))
        stress.setdefault(key, collision | {"share": 0.0})["share"] += 1.0 / len(stress_test.futures)
    return stress


@lru_cache(maxsize=4)
def _models(question: Question) -> tuple[RunSettings, ModelSet]:
    settings = RunSettings(
        futures=max(question.futures, 1),
        models=question.models,
        seed=question.seed,
        metrics="gap",
        world="plain",
    )
    return settings, ModelSet.of(settings)


def _ghosts(
    scene: SeedScene, names: Mapping[int, str], worst: PairRisk | None, stress_test: Part | None
) -> dict[str, FloatArray]:
    """Return outlines of the two vehicles in a typical future in which they collide, else come nearest."""
    tracks = {name: v for v, track in enumerate(scene.track_ids.tolist()) for name in [names[int(track)]]}
    if worst is None or stress_test is None or not set(worst.names) <= tracks.keys():
        return {}
    indices = [tracks[name] for name in worst.names]
    states = stress_test.states[:, :, indices]
    apart = np.hypot(states.x[..., 0] - states.x[..., 1], states.y[..., 0] - states.y[..., 1])
    nearest = apart.min(axis=1)
    future = int(np.argmin(nearest))
    last = int(apart[future].argmin()) + 1
    drawn = states[future, :last:_GHOST_STEPS]
    shapes = outlines(drawn, scene.length[indices], scene.width[indices], BOX[[0, 1, 2, 3, 0]])
    return {name: shapes[:, k] for k, name in enumerate(worst.names)}
