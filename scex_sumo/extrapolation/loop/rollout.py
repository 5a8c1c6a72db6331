"""Rollout of futures in closed loop: models plan, the world steps, models see the result.

A plan that cannot be used is replaced by the path-following driver's, and listed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ScexError
from scex_sumo.behaviors.base import BY_ITSELF, PLAN_STEPS, BatchBehavior
from scex_sumo.extrapolation.loop.crashes import Crashes, slide
from scex_sumo.extrapolation.loop.situations import plans_of
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex
from scex_sumo.world.base import World


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollout:
    """States of a batch of futures, read back from the world.

    Attributes:
        states: (C, T, V) after each step.
        plan_x: (C, R, V, H) centres planned at each of the R replans, m; so ``plan_y``.
        with_crashes: vehicles that touch have collided, and stop.
        present: (C, T, V) False of vehicles that have arrived, which stand far away; None: all are there.
    """

    states: States
    plan_x: FloatArray
    plan_y: FloatArray
    replan: int
    replaced: tuple[Replaced, ...] = ()
    with_crashes: bool = False
    present: BoolArray | None = None

    @property
    def seen(self) -> States:
        """The states, NaN of vehicles that have arrived."""
        there = self.present
        return self.states if there is None else self.states.map(lambda v: np.where(there, v, np.nan))


class Replaced(NamedTuple):
    """A plan of the path-following driver in the place of a model's.

    Attributes:
        step: steps since the seed scene.
        vehicle: index into the seed scene.
        model: name.
    """

    future: int
    step: int
    vehicle: int
    model: str
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Futures that run side by side, and the models of their vehicles.

    Attributes:
        assignment: (C, V) index into ``models``.
        overridden: (M,) False for SUMO's own models, whose vehicles the world drives.
        route_draw: (C, V) in [0, 1).
        generators: (C,) random numbers of each future.
    """

    futures: IntArray
    assignment: IntArray
    models: Sequence[BatchBehavior]
    names: Sequence[str]
    overridden: BoolArray
    route_draw: FloatArray
    generators: Sequence[np.random.Generator]


def roll_out(
    world: World,
    road: Road,
    scene: SeedScene,
    batch: Batch,
    *,
    steps: int,
    replan: int,
    on_step: Callable[[int], None] | None = None,
    crash: bool = True,
) -> Rollout:
    """Simulate a batch of futures from the seed scene.

    All models see the same history, then all vehicles move. Vehicles that have collided slide to rest.

    Args:
        world: holds the seed scene in each of its C tiles.
        steps: of 0.1 s.
        replan: steps that a plan is followed, up to 30.
        on_step: called after each step with the number of futures.
        crash: False: vehicles drive on after a contact, as recorded boxes do, which are inexact.

    Raises:
        ScexError: a model's plan is too short or not finite.
    """
    count, vehicles = batch.assignment.shape
    window = scene.history.repeat(count)
    override = batch.overridden[batch.assignment]
    crashes, arrivals = Crashes(scene, count), Arrivals(scene)
    crashed, gone = crashes.crashed, np.zeros((count, vehicles), dtype=np.bool_)
    present = np.ones((count, steps, vehicles), dtype=np.bool_)
    rounds = -(-steps // replan)
    plan_x = np.empty((count, rounds, vehicles, PLAN_STEPS))
    plan_y = np.empty_like(plan_x)
    simulated = States.empty((count, steps, vehicles))
    plan = States.empty((count, vehicles, PLAN_STEPS))
    replaced: list[Replaced] = []
    for step in range(steps):
        if step % replan == 0:
            history = history_at(scene, window, batch.futures, batch.route_draw, step=step)
            left = crashed | gone
            groups = groups_of(np.where(left, -1, batch.assignment), len(batch.models))
            for index, model_plan in plans_of(batch.models, groups, history, road, batch.generators):
                group, name = groups[index], batch.names[index]
                usable = checked_plan(model_plan, len(group), PLAN_STEPS, name)
                plan.assign((group.future, group.vehicle), usable)
                replaced += _replaced(model_plan, group, batch, step, name)
            now = window[:, :, -1][left]
            plan.assign(np.nonzero(left), slide(now, now.speed, PLAN_STEPS))
            plan_x[:, step // replan], plan_y[:, step // replan] = plan.x, plan.y
        before, column = window[:, :, -1], step % replan
        world.move(plan[:, :, column], override | crashed)
        if scene.obstacles is not None:
            world.move_obstacles(*scene.obstacles.at(step + 1))
        world.step()
        read = world.read()
        gone = gone | np.isnan(read.x) | arrivals.reached(read)
        if gone.any():
            present[:, step] = ~gone
            read = far_away(read, gone)
            window = far_away(window, gone[:, :, None])
            before = window[:, :, -1]
        simulated.assign((slice(None), step), read)
        window = States.concatenate([window[:, :, 1:], read[:, :, None]], axis=2)
        if crash:
            vehicles_hit, motion = crashes.after_step(before, read, PLAN_STEPS - column - 1)
            plan.assign((*vehicles_hit, slice(column + 1, None)), motion)
        if on_step is not None:
            on_step(count)
    return Rollout(
        states=simulated,
        plan_x=plan_x,
        plan_y=plan_y,
        replan=replan,
        replaced=tuple(replaced),
        with_crashes=crash,
        present=None if present.all() else present,
    )


def history_at(
    scene: SeedScene, window: States, futures: IntArray, route_draw: FloatArray, *, step: int
) -> SceneHistory:
    """Return the models' input ``step`` steps after the seed scene; ``window`` (C, V, 11) are states."""
    states = window.map(_read_only)
    return SceneHistory(scene=scene, states=states, futures=futures, step=step, route_draw=route_draw)


def _read_only(values: FloatArray) -> FloatArray:
    view = values.view()
    view.flags.writeable = False
    return view


def groups_of(assignment: IntArray, models: int) -> list[VehicleIndex]:
    """Return the vehicles of each model, by assignments (C, V)."""
    drivers = (np.nonzero(assignment == model) for model in range(models))
    return [VehicleIndex(future=future, vehicle=vehicle) for future, vehicle in drivers]


def checked_plan(plan: Plan, count: int, steps: int, name: str) -> States:
    """Return the first (n, steps) states of a model's plan; raise a `ScexError` for a bad plan."""
    for key in ("x", "y", "heading", "speed"):
        values = getattr(plan, key)
        if values.ndim != 2 or values.shape[0] != count or values.shape[1] < steps:
            raise ScexError(
                f"behaviour model {name}: plan.{key} has shape {values.shape}, "
                f"needs ({count}, {steps}) or more steps"
            )
        if bad := int((~np.isfinite(values[:, :steps])).any(axis=1).sum()):
            raise ScexError(f"behaviour model {name}: plan.{key} is not finite for {bad} of {count} vehicles")
    return plan[:, :steps]


def _replaced(plan: Plan, vehicles: VehicleIndex, batch: Batch, step: int, model: str) -> list[Replaced]:
    if plan.fallback is None:
        return []
    return [
        Replaced(
            future=int(batch.futures[vehicles.future[index]]),
            step=step,
            vehicle=int(vehicles.vehicle[index]),
            model=model,
            reason=plan.reasons[index] if plan.reasons else BY_ITSELF,
        )
        for index in np.flatnonzero(plan.fallback).tolist()
    ]


FAR_M: Final = 1e6
FAR_APART_M: Final = 1e3

_BEYOND_M = (0.0, 10.0)  # of the front bumper
_ASIDE_M = 2.0
_TURNED_COS = 0.5


class Arrivals:
    """Places where the vehicles of a scene arrive."""

    def __init__(self, scene: SeedScene) -> None:
        known = [
            (v, *place)
            for v, intention in enumerate(scene.intentions)
            if intention is not None
            for place in intention.arrives
        ]
        places = np.array(known, dtype=np.float64).reshape(-1, 4)
        self._vehicle, (self._x, self._y, self._heading) = places[:, 0].astype(np.int64), places[:, 1:].T
        self._half = scene.length[self._vehicle] / 2

    def reached(self, states: States) -> BoolArray:
        """Return whether vehicles (C, V) have arrived."""
        reached = np.zeros(states.shape, dtype=np.bool_)
        if not len(self._vehicle):
            return reached
        now, c, s = states[:, self._vehicle], np.cos(self._heading), np.sin(self._heading)
        dx, dy = now.x - self._x, now.y - self._y
        turned = np.cos(now.heading - self._heading)
        beyond, aside = dx * c + dy * s + self._half * turned, dy * c - dx * s
        there = (beyond >= _BEYOND_M[0]) & (beyond <= _BEYOND_M[1])
        there &= (np.abs(aside) <= _ASIDE_M) & (turned >= _TURNED_COS)
        future, place = np.nonzero(there)
        reached[future, self._vehicle[place]] = True
        return reached


def far_away(states: States, gone: BoolArray) -> States:
    """Return states (C, V, ...) in which some vehicles stand where no other one sees them, nor each other."""
    vehicle = np.arange(gone.shape[1]).reshape((-1, *(1,) * (gone.ndim - 2)))
    return States(
        x=np.where(gone, FAR_M + FAR_APART_M * vehicle, states.x),
        y=np.where(gone, FAR_M, states.y),
        heading=np.where(gone, 0.0, states.heading),
        speed=np.where(gone, 0.0, states.speed),
    )
