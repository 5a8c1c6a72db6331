"""Models of a run: built, with who is drawn, fixed and under test."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from scex_sumo.arrays import IntArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.learned.models import LearnedModel
from scex_sumo.behaviors.plug_in.fallback import Fallible
from scex_sumo.behaviors.plug_in.usable import source_file
from scex_sumo.behaviors.registry import ModelSpec, build, is_own, may_fail, parse_models
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.assignments import assignments, child_generator, listing, route_draws
from scex_sumo.extrapolation.rollout import history_at
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scene import SeedScene, Who


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSet:
    """The models of a run.

    Attributes:
        drawn: models to draw from.
        specs: all models, those of fixed vehicles included; assignments are indices into it.
        fixed: index of the model by track id, for vehicles that are not drawn.
        tested: model by track id for vehicles under test; None where one is driven as drawn.
        built: the models themselves, by index.
    """

    drawn: tuple[ModelSpec, ...]
    specs: tuple[ModelSpec, ...]
    fixed: Mapping[int, int]
    tested: Mapping[int, str | None]
    built: tuple[Behavior, ...]

    @classmethod
    def of(cls, settings: RunSettings) -> ModelSet:
        """Build the models that settings name.

        Raises:
            UsageError: a model that makes no sense or cannot be made.
        """
        tested = settings.under_test
        specs, names = list(settings.drawn), [str(spec) for spec in settings.drawn]
        fixed = {}
        for track, text in [*settings.assign.items(), *tested.items()]:
            if text is None:
                continue
            wanted = parse_models(text)
            if len(wanted) != 1:
                option = "--under-test" if track in tested else "--assign"
                raise UsageError(f"{option} {track}={text}: names {len(wanted)} models; give one")
            if str(wanted[0]) not in names:
                specs.append(wanted[0])
                names.append(str(wanted[0]))
            fixed[int(track)] = names.index(str(wanted[0]))
        built = tuple(_usable(spec) for spec in specs)
        return cls(drawn=settings.drawn, specs=tuple(specs), fixed=fixed, tested=tested, built=built)

    @property
    def names(self) -> tuple[str, ...]:
        """All models as on the command line, without weights."""
        return tuple(str(spec) for spec in self.specs)

    @cached_property
    def weights(self) -> dict[str, str]:
        """SHA-256 of the weights of each learned model, by its name."""
        found = {name: getattr(model, "weights_sha256", None) for _, name, model in self._bare()}
        return {name: sha256 for name, sha256 in found.items() if isinstance(sha256, str)}

    @cached_property
    def sources(self) -> dict[str, str]:
        """SHA-256 of the file of each of the user's own models, by its name, where there is one."""
        files = {name: source_file(model) for spec, name, model in self._bare() if is_own(spec)}
        return {
            name: hashlib.sha256(file.read_bytes()).hexdigest()
            for name, file in files.items()
            if file is not None and file.is_file()
        }

    def keep_images(self) -> None:
        """Have learned drivers keep in the user's cache what they make of a map."""
        for _, _, model in self._bare():
            if isinstance(model, LearnedModel):
                model.driver.keeps = True

    def _bare(self) -> Iterator[tuple[ModelSpec, str, Behavior]]:
        """Each model without its guard and stand-in."""
        for spec, name, model in zip(self.specs, self.names, self.built, strict=True):
            while isinstance(model, Guarded | Fallible):
                model = model.model
            yield spec, name, model

    def draw(
        self, track_ids: IntArray, *, children: int | None, seed: int, design: str, keep: bool = False
    ) -> IntArray:
        """(C, V) model of every vehicle in every child, as `assignments`.

        A vehicle under test takes part in the draw and then gets its model, so that all others have the
        models that they have without it.

        Raises:
            UsageError: a track id that the seed scene has not, and what `assignments` raises.
        """
        ids = [int(track) for track in track_ids]
        unknown = sorted(set(self.tested) - set(ids))
        if unknown:
            # A model of the user's own is under test by --assign as well.
            raise UsageError(
                f"--assign or --under-test: no vehicle {unknown[0]} in the seed scene; "
                f"its vehicles: {listing(ids)}"
            )
        always = {track: model for track, model in self.fixed.items() if track not in self.tested}
        weights = [spec.weight for spec in self.drawn]
        drawn = assignments(
            weights, ids, children=children, seed=seed, fixed=always, design=design, keep=keep
        )
        for track, model in self.tested.items():
            if model is not None:
                drawn[:, ids.index(track)] = self.fixed[track]
        return drawn

    def try_on(self, scene: SeedScene, *, seed: int) -> None:
        """Let every model that may fail plan once for the vehicles of the seed scene that it may get.

        Raises:
            ScexError: one has no usable plan for any of them.
        """
        assert scene.road is not None
        children = np.zeros(1, dtype=np.int64)
        draw = route_draws(children, scene.vehicles, seed=seed)
        history = history_at(scene, scene.history.repeat(1), children, draw, step=0)
        tracks = scene.track_ids.tolist()
        for index, driver in enumerate(self.built):
            model = driver.model if isinstance(driver, Guarded) else driver
            if not isinstance(model, Fallible):
                continue
            mine = [self.fixed.get(t, index if index < len(self.drawn) else -1) == index for t in tracks]
            vehicle = np.flatnonzero(np.array(mine, dtype=np.bool_))
            who = Who(child=np.zeros_like(vehicle), vehicle=vehicle)
            model.try_on(history, scene.road, who, [child_generator(seed, 0)])

    def to_json(self) -> dict[str, Any]:
        """What ``run.json`` says of them."""
        return {
            "models": [{"model": str(s), "weight": s.weight} for s in self.drawn],
            "weights": self.weights,
            "sources": self.sources,
            "assign": {str(t): self.names[m] for t, m in sorted(self.fixed.items())},
            "under_test": {str(t): model for t, model in sorted(self.tested.items())},
        }


def _usable(spec: ModelSpec) -> Behavior:
    """A model that cannot fail: where it may, the path-following driver stands in, the guard over both."""
    model = build(spec)
    if not may_fail(spec):
        return model
    if isinstance(model, Guarded):
        return Guarded(Fallible(model.model, str(spec)), model.profile)
    return Fallible(model, str(spec))
