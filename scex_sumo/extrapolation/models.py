"""Models of a run, and the vehicles that are drawn, fixed and under test."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import sha256_of
from scex_sumo.behaviors.base import Behavior, layer_with
from scex_sumo.behaviors.registry import ModelSpec, build, is_own, model_specs, refuse_namesake
from scex_sumo.extrapolation.assignments import assignments, future_generator, listing, route_draws
from scex_sumo.extrapolation.rollout import history_at
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scene import SeedScene, VehicleIndex


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSet:
    """The models of a run.

    Attributes:
        specs: all models, those of fixed vehicles included; assignments are indices into it.
        fixed: index of the model by track id, for vehicles that are not drawn.
        tested: model by track id for vehicles under test; None: as drawn.
    """

    drawn: tuple[ModelSpec, ...]
    specs: tuple[ModelSpec, ...]
    fixed: Mapping[int, int]
    tested: Mapping[int, str | None]
    built: tuple[Behavior, ...]

    @classmethod
    def of(cls, settings: RunSettings) -> ModelSet:
        """Build the models that settings name; raise a `UsageError` for a bad one."""
        tested = settings.under_test
        specs, fixed = {str(spec): spec for spec in settings.drawn}, {}
        for track, given in [*settings.assign.items(), *tested.items()]:
            if given is None:
                continue
            wanted = model_specs(given)
            if len(wanted) != 1:
                option = "--under-test" if track in tested else "--assign"
                raise UsageError(f"{option} {track}={given}: names {len(wanted)} models; give one")
            refuse_namesake(wanted[0], specs.setdefault(str(wanted[0]), wanted[0]))
            fixed[int(track)] = list(specs).index(str(wanted[0]))
        return cls(
            drawn=settings.drawn,
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
        return {str(spec): model.weights_sha256 for spec, model in self._with("weights_sha256")}

    @cached_property
    def sources(self) -> dict[str, str]:
        """SHA-256 of the source file of each of the user's models, by name."""
        files = {str(s): model.source_file for s, model in self._with("source_file") if is_own(s)}
        return {name: sha256_of(file) for name, file in files.items() if file is not None and file.is_file()}

    def keep_images(self) -> None:
        """Let learned drivers cache their map features on the disk."""
        for _, model in self._with("keep_images"):
            model.keep_images()

    def _with(self, attribute: str) -> Iterator[tuple[ModelSpec, Any]]:
        """Yield the spec of each model that has an attribute, and the layer that has it."""
        for spec, model in zip(self.specs, self.built, strict=True):
            if (layer := layer_with(model, attribute)) is not None:
                yield spec, layer

    def draw(
        self, track_ids: IntArray, *, futures: int | None, seed: int, design: str, keep: bool = False
    ) -> IntArray:
        """Return the model (C, V) of every vehicle in every future, as `assignments`.

        A vehicle under test takes part in the draw: the draw of the others does not depend on it.
        """
        ids = [int(track) for track in track_ids]
        unknown = sorted(set(self.tested) - set(ids))
        if unknown:
            raise UsageError(
                f"--assign or --under-test: no vehicle {unknown[0]} in the seed scene; "
                f"its vehicles: {listing(ids)}"
            )
        always = {track: model for track, model in self.fixed.items() if track not in self.tested}
        weights = [spec.weight for spec in self.drawn]
        drawn = assignments(weights, ids, futures=futures, seed=seed, fixed=always, design=design, keep=keep)
        for track, model in self.tested.items():
            if model is not None:
                drawn[:, ids.index(track)] = self.fixed[track]
        return drawn

    def try_on(self, scene: SeedScene, *, seed: int) -> None:
        """Let every model that may fail plan once; raise a `ScexError` if no plan of one is usable."""
        assert scene.road is not None
        futures = np.zeros(1, dtype=np.int64)
        draw = route_draws(futures, scene.vehicles, seed=seed)
        history = history_at(scene, scene.history.repeat(1), futures, draw, step=0)
        tracks = scene.track_ids.tolist()
        for index, driver in enumerate(self.built):
            fallible = layer_with(driver, "try_on")
            if fallible is None:
                continue
            mine = [self.fixed.get(t, index if index < len(self.drawn) else -1) == index for t in tracks]
            vehicle = np.flatnonzero(np.array(mine, dtype=np.bool_))
            who = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
            fallible.try_on(history, scene.road, who, [future_generator(seed, 0)])

    def to_json(self) -> dict[str, Any]:
        """Return the models' entries of ``run.json``."""
        return {
            "models": [{"model": str(s), "weight": s.weight} for s in self.drawn],
            "weights": self.weights,
            "sources": self.sources,
            **({"objects": objects} if (objects := {str(s): s.state for s in self.specs if s.state}) else {}),
            "assign": {str(t): self.names[m] for t, m in sorted(self.fixed.items())},
            "under_test": {str(t): model for t, model in sorted(self.tested.items())},
        }
