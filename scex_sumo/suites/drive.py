"""Futures of a case: a driving function in closed loop among human-like drivers, and what comes of it.

P of a contact follows by the law of `scex_sumo.decision`, from what the function's vehicle comes to. Draws
follow from the suite's seed and the number of the future, the same for all functions. People are the
human-like driver in the place of the function.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.decision.law import law, over_futures, roots
from scex_sumo.decision.pairs import pair_table
from scex_sumo.drivers.registry import ModelSpec, build, parse_models
from scex_sumo.extrapolation.assignments import future_generator, route_draws
from scex_sumo.extrapolation.loop.measure import measure_conflicts
from scex_sumo.extrapolation.loop.rollout import Batch, roll_out
from scex_sumo.results.participants import everybody, with_everybody
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States
from scex_sumo.world.plain import PlainWorld

STEPS: Final = 30
REPLAN: Final = 5
PEOPLE: Final = "likely_driver"
"""Driver of all others."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """P of a contact in each future (C,), and of all."""

    by_future: FloatArray

    @cached_property
    def root(self) -> FloatArray:
        """Cube roots (C,) of P, the largest as the second one: what the law takes the mean of."""
        return roots(np.zeros(len(self.by_future), dtype=np.int64), self.by_future, len(self.by_future))

    @property
    def probability(self) -> float:
        """P of a contact, see `over_futures`."""
        count = len(self.by_future)
        return float(over_futures(np.zeros(count, dtype=np.int64), self.by_future, pairs=1, futures=count)[0])

    @property
    def effects(self) -> FloatArray:
        """First-order effect (C,) of each future on `probability`; their mean is 0."""
        return np.asarray(3 * self.root.mean() ** 2 * (self.root - self.root.mean()))


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """Futures of a case, (C,) of them: states (C, V, T) from the moment on of all that `everybody` has.

    The function drives one vehicle, an index; conflicts are those of that vehicle.
    """

    scene: SeedScene
    vehicle: int
    states: States
    conflicts: Conflicts

    @property
    def futures(self) -> int:
        """Number of futures."""
        return self.states.shape[0]

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts of the vehicle with any other one."""
        return self._contacts(np.ones(len(self.conflicts), dtype=np.bool_))

    def contacts_with(self, other_id: int) -> Contacts:
        """Return the contacts of the vehicle with one other."""
        other = self.index_of(other_id)
        return self._contacts((self.conflicts.one == other) | (self.conflicts.two == other))

    def _contacts(self, rows: BoolArray) -> Contacts:
        conflicts = self.conflicts.take(rows)
        probability = law().contact(conflicts, everybody(self.scene).types)
        with np.errstate(divide="ignore"):
            log = np.bincount(conflicts.future, np.log1p(-probability), minlength=self.futures)
        return Contacts(by_future=np.asarray(-np.expm1(log)))

    @property
    def collides(self) -> BoolArray:
        """Whether the vehicle collides in each future (C,)."""
        hits = np.bincount(self.conflicts.future, self.conflicts.gap <= 0, minlength=self.futures)
        return np.asarray(hits > 0)

    @cached_property
    def pairs(self) -> list[Mapping[str, Any]]:
        """Rows as of `PAIRS` with each other one, the most probable contact first."""
        table = pair_table(
            self.scene, self.conflicts, futures=self.futures, states_of=lambda future: self.states[future]
        )
        rows: list[Mapping[str, Any]] = table.to_pylist()
        return rows

    def index_of(self, track_id: int) -> int:
        """Return the index of a road user into `everybody`."""
        return int(np.flatnonzero(everybody(self.scene).track_ids == track_id)[0])

    def row_of(self, other_id: int) -> Mapping[str, Any]:
        """Return the row of `pairs` with another one; some columns of one if they never come near."""
        pairs = (pair for pair in self.pairs if other_id in (pair["track_id"], pair["other_id"]))
        own = int(self.scene.track_ids[self.vehicle])
        apart = {"track_id": own, "other_id": other_id, "future": 0, "needed_braking": 0.0, "conflict_s": 0.0}
        return next(pairs, apart | dict.fromkeys(("what", "how", "time_margin", "gap_m")))


def drive(scene: SeedScene, track_id: int, spec: ModelSpec | None, futures: int, *, seed: int) -> Driven:
    """Run the futures of a case, in which a function, or a human-like driver, drives the vehicle of a track.

    The function is ``spec``; None or `PEOPLE` is the driver. The scene has road and rules. A `ScexError` says
    which plan of the function cannot be used.
    """
    assert scene.road is not None
    index = int(np.flatnonzero(scene.track_ids == track_id)[0])
    names = [PEOPLE] if spec is None or str(spec) == PEOPLE else [PEOPLE, str(spec)]
    assignment = np.zeros((futures, scene.vehicles), dtype=np.int64)
    assignment[:, index] = len(names) - 1
    numbers = np.arange(futures)
    batch = Batch(
        futures=numbers,
        assignment=assignment,
        models=[
            build(parse_models(PEOPLE)[0]),
            *([build(spec, fallback=True)] if spec and names[1:] else []),
        ],
        names=names,
        overridden=np.ones(len(names), dtype=np.bool_),
        route_draw=route_draws(numbers, scene.vehicles, seed=seed),
        generators=[future_generator(seed, c) for c in range(futures)],
    )
    world = PlainWorld(futures, scene.vehicles, length=scene.length)
    rollout = roll_out(world, scene.road, scene, batch, steps=STEPS, replan=REPLAN)
    replaced = [plan for plan in rollout.replaced if plan.vehicle == index]
    if replaced:
        problem = f"{len(replaced)} plans cannot be used, the first at {replaced[0].step * STEP_S:g} s"
        raise ScexError(f"{names[-1]}: {problem}: {replaced[0].reason}")
    return Driven(
        scene=scene,
        vehicle=index,
        states=with_everybody(scene, rollout.states)[:, HISTORY_STEPS:].swapaxes(1, 2),
        conflicts=measure_conflicts(scene, rollout, vehicle=index),
    )
