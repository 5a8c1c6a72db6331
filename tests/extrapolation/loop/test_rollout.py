"""The closed loop: everybody sees the same moment, plans are followed, checked and renewed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import ScexError
from scex_sumo.extrapolation.loop.rollout import Batch, Replaced, roll_out
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.seeds import Straight, straight_seed

ROAD = Road(name="empty", lanes={})


class PlainWorld:
    """Holds what it is told; where nothing is overridden, vehicles stand."""

    def __init__(self, start: States, drift: float = 0.0) -> None:
        self.states = start
        self.drift = drift
        self.masks: list[BoolArray] = []

    def move(self, states: States, mask: BoolArray) -> None:
        self.masks.append(mask)
        moved = self.states.map(np.copy)
        moved.assign(mask, states[mask])
        self.states = moved

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        raise AssertionError("there are no obstacles")

    def step(self) -> None:
        self.states.x[...] += self.drift

    def read(self) -> States:
        return self.states.map(np.copy)


def cast_of(model: Straight, scene: SeedScene, futures: int, *, overridden: bool = True) -> Batch:
    return Batch(
        futures=np.arange(futures),
        assignment=np.zeros((futures, scene.vehicles), dtype=np.int64),
        models=[model],
        names=["forward"],
        overridden=np.array([overridden]),
        route_draw=np.zeros((futures, scene.vehicles)),
        generators=[np.random.default_rng(c) for c in range(futures)],
    )


def test_models_see_eleven_states_ending_in_the_present() -> None:
    scene = straight_seed()
    model = Straight()
    roll_out(PlainWorld(scene.now.repeat(2)), ROAD, scene, cast_of(model, scene, 2), steps=10, replan=5)
    first, second = model.seen
    assert first.step == 0
    assert np.array_equal(first.states.x[1], scene.history.x)
    assert second.step == 5
    assert second.states.x[1, 0] == pytest.approx(np.arange(-5, 6) * 1.0)


@pytest.mark.parametrize(
    ("steps", "replan", "plans"), [(30, 5, 6), (30, 10, 3), (12, 5, 3), (1, 5, 1), (4, 1, 4)]
)
def test_plans_are_renewed_every_replan_steps(steps: int, replan: int, plans: int) -> None:
    scene = straight_seed()
    model = Straight()
    rollout = roll_out(
        PlainWorld(scene.now.repeat(1)), ROAD, scene, cast_of(model, scene, 1), steps=steps, replan=replan
    )
    assert len(model.seen) == plans
    assert rollout.plan_x.shape == (1, plans, 2, 30)
    assert rollout.states.shape == (1, steps, 2)


def test_vehicles_that_the_world_drives_are_not_moved() -> None:
    scene = straight_seed()
    world = PlainWorld(scene.now.repeat(1))
    roll_out(world, ROAD, scene, cast_of(Straight(), scene, 1, overridden=False), steps=3, replan=5)
    assert not np.any(world.masks)


def test_a_short_plan_is_an_error_that_names_the_model() -> None:
    scene = straight_seed()
    short = Straight(lambda plan, _: Plan(x=plan.x[:, :9], y=plan.y, heading=plan.heading, speed=plan.speed))
    with pytest.raises(
        ScexError, match=r"behaviour model forward: plan.x has shape \(2, 9\), needs \(2, 30\)"
    ):
        roll_out(PlainWorld(scene.now.repeat(1)), ROAD, scene, cast_of(short, scene, 1), steps=3, replan=5)


def test_a_plan_that_is_not_finite_is_an_error_with_the_count() -> None:
    scene = straight_seed()

    def spoil(plan: Plan, _: VehicleIndex) -> Plan:
        plan.speed[1, 7] = np.nan
        return plan

    with pytest.raises(ScexError, match=r"plan\.speed is not finite for 1 of 2 vehicles"):
        roll_out(
            PlainWorld(scene.now.repeat(1)),
            ROAD,
            scene,
            cast_of(Straight(spoil), scene, 1),
            steps=3,
            replan=5,
        )


def test_plans_that_are_not_the_models_own_are_counted_with_future_vehicle_step_and_reason() -> None:
    scene = straight_seed()

    def fall_back(plan: Plan, _: VehicleIndex) -> Plan:
        late = plan.x[:, 0] > 3.0  # the second plan, made at x = 5 m
        return dataclasses.replace(
            plan, fallback=late & (np.arange(len(late)) == 0), reasons=("lost",) * len(late)
        )

    batch = dataclasses.replace(cast_of(Straight(fall_back), scene, 1), futures=np.array([7]))
    rollout = roll_out(PlainWorld(scene.now.repeat(1)), ROAD, scene, batch, steps=10, replan=5)
    assert rollout.replaced == (Replaced(future=7, step=5, vehicle=0, model=batch.names[0], reason="lost"),)


def test_no_model_can_change_what_the_others_see() -> None:
    scene = straight_seed()

    class Careless(Straight):
        def plan(
            self,
            history: SceneHistory,
            road: Road,
            vehicles: VehicleIndex,
            rng: Sequence[np.random.Generator],
        ) -> Plan:
            history.states.x[...] -= 100.0
            return super().plan(history, road, vehicles, rng)

    with pytest.raises(ValueError, match="read-only"):
        world, cast = PlainWorld(scene.now.repeat(1)), cast_of(Careless(), scene, 1)
        roll_out(world, ROAD, scene, cast, steps=1, replan=5)
