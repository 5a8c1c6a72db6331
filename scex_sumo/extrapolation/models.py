"""Models of a run, and the vehicles that are drawn, fixed and under test."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.owned import SentOnce
from scex_sumo.behaviors.base import BatchBehavior, Driver, driven_by_sumo, layers
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.drivers.registry import ModelSpec, build, is_own, model_specs, moved_by, refuse_namesake
from scex_sumo.extrapolation.assignments import assignments, future_generator, people_assignments, route_draws
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scene import SeedScene, VehicleIndex


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSet(SentOnce):
    """The models of a run.

    Attributes:
        specs: all models, those of fixed vehicles and of people included; assignments are indices into it.
        people: weights of models, as indices, by kind of people; empty if they are replayed.
        fixed: index of the model by track id, for vehicles that are not drawn.
        tested: model by track id for vehicles under test; None: as drawn.
    """

    drawn: tuple[ModelSpec, ...]
    specs: tuple[ModelSpec, ...]
    fixed: Mapping[Any, int]
    tested: Mapping[Any, str | None]
    people: Mapping[str, Mapping[int, float]]
    built: tuple[BatchBehavior, ...]

    @property
    def world(self) -> str:
        """The simplest world for them: ``sumo`` if SUMO drives a vehicle, else ``plain``."""
        return "sumo" if any(map(driven_by_sumo, self.built)) else "plain"

    @classmethod
    def of(cls, settings: RunSettings) -> ModelSet:
        """Build the models that settings name; raise a `UsageError` for a bad one."""
        tested = settings.under_test
        drawn = tuple(spec for spec in settings.drawn if not moved_by(spec))
        walking = _of_people(settings, [spec for spec in settings.drawn if moved_by(spec)])
        if not any(spec.weight > 0 for spec in drawn):
            raise UsageError("--models: names no model of vehicles; give one, e.g. standard_driver")
        specs, fixed = {str(spec): spec for spec in drawn}, dict[Any, int]()
        for track, given in [*settings.assign.items(), *tested.items()]:
            if given is None:
                continue
            wanted = model_specs(given)
            if len(wanted) != 1:
                option = "--under-test" if track in tested else "--assign"
                raise UsageError(f"{option} {track}={given}: names {len(wanted)} models; give one")
            refuse_namesake(wanted[0], specs.setdefault(str(wanted[0]), wanted[0]))
            fixed[track] = list(specs).index(str(wanted[0]))
        specs |= {str(spec): spec for spec in walking if str(spec) not in specs}
        place = {name: index for index, name in enumerate(specs)}
        kinds = {kind for spec in walking for kind in moved_by(spec)}
        return cls(
            drawn=drawn,
            people={
                kind: {place[str(s)]: s.weight for s in walking if kind in moved_by(s) and s.weight > 0}
                for kind in sorted(kinds)
            },
            specs=tuple(specs.values()),
            fixed=fixed,
            tested={t: None if given is None else str(*model_specs(given)) for t, given in tested.items()},
            built=tuple(build(spec, fallback=True) for spec in specs.values()),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names as on the command line, without weights."""
        return tuple(str(spec) for spec in self.specs)

    @cached_property
    def weights(self) -> dict[str, str]:
        """SHA-256 of each learned model's weights, by name."""
        return {str(spec): sha for spec, model in self._layers() if (sha := model.weights_sha256) is not None}

    @cached_property
    def sources(self) -> dict[str, str]:
        """SHA-256 of the source file of each of the user's models, by name."""
        files = {str(s): file for s, model in self._layers() if is_own(s) and (file := model.source_file)}
        return {name: sha256_of(file) for name, file in files.items() if file.is_file()}

    def _layers(self) -> Iterator[tuple[ModelSpec, Driver]]:
        """Yield the spec of each model, and each of its layers."""
        for spec, model in zip(self.specs, self.built, strict=True):
            for layer in layers(model):
                yield spec, layer

    def draw(self, scene: SeedScene, *, futures: int | None, seed: int, keep: bool = False) -> IntArray:
        """Return the model (C, V) of every vehicle in every future, as `assignments`.

        A vehicle under test takes part in the draw: the draw of the others does not depend on it.
        """
        ids = [int(track) for track in scene.track_ids]
        people = self._drawing(scene)
        if futures is None and any(len(self.people[scene.types[k]]) > 1 for k in people):
            raise UsageError("--futures all: people draw models, too; name one model for each kind")
        always = {ids[k]: min(self.people[scene.types[k]]) for k in people}
        always |= {track: model for track, model in self.fixed.items() if track not in self.tested}
        weights = [spec.weight for spec in self.drawn]
        drawn = assignments(weights, ids, futures=futures, seed=seed, fixed=always, keep=keep)
        if people:
            kinds = [scene.types[k] for k in people]
            drawn[:, people] = people_assignments(self.people, kinds, len(drawn), seed=seed)
        for track, model in self.tested.items():
            if model is not None:
                drawn[:, ids.index(track)] = self.fixed[track]
        return drawn

    def _drawing(self, scene: SeedScene) -> list[int]:
        """Return the people (indices) that draw a model."""
        people = [] if scene.people is None else np.flatnonzero(scene.people).tolist()
        kinds = dict(zip(scene.track_ids.tolist(), scene.types, strict=True))
        for track, index in self.fixed.items():
            moves = moved_by(self.specs[index])
            if moves and kinds.get(track, moves[0]) not in moves:
                what = f"--assign {track}={self.names[index]}: moves no {kinds[track]}"
                raise UsageError(f"{what}; give a model of vehicles")
        return [k for k in people if int(scene.track_ids[k]) not in self.fixed]

    def try_on(self, scene: SeedScene, *, seed: int) -> None:
        """Let every model that may fail plan once; raise a `ScexError` if no plan of one is usable."""
        assert scene.road is not None
        futures = np.zeros(1, dtype=np.int64)
        draw = route_draws(futures, scene.vehicles, seed=seed)
        history = history_at(scene, scene.history.repeat(1), futures, draw, step=0)
        tracks = scene.track_ids.tolist()
        for index, driver in enumerate(self.built):
            mine = [self.fixed.get(t, index if index < len(self.drawn) else -1) == index for t in tracks]
            vehicle = np.flatnonzero(np.array(mine, dtype=np.bool_))
            vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
            for layer in layers(driver):
                layer.try_on(history, scene.road, vehicles, [future_generator(seed, 0)])

    def to_json(self) -> dict[str, Any]:
        """Return the models' entries of ``run.json``."""
        people = {kind: {self.names[k]: w for k, w in of.items()} for kind, of in self.people.items()}
        return {
            "models": [{"model": str(s), "weight": s.weight} for s in self.drawn],
            **({"people": people} if people else {}),
            "weights": self.weights,
            "sources": self.sources,
            **({"objects": objects} if (objects := {str(s): s.state for s in self.specs if s.state}) else {}),
            "assign": {str(t): self.names[m] for t, m in sorted(self.fixed.items())},
            "under_test": {str(t): model for t, model in sorted(self.tested.items())},
        }


def _of_people(settings: RunSettings, given: Sequence[ModelSpec]) -> list[ModelSpec]:
    """Return the models of people: the given ones, and those of the mix ``people`` for other kinds."""
    if settings.vru != "model":
        if given:
            raise UsageError(f"--models {given[0]}: moves people, which needs --vru model")
        return []
    known = {kind for spec in given if spec.weight > 0 for kind in moved_by(spec)}
    usual = model_specs("people")
    missing = [spec for spec in usual if not known.issuperset(moved_by(spec))]
    assert known.union(*map(moved_by, missing)).issuperset(PEOPLE)
    return [*given, *missing]
