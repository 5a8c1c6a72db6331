"""Distinct situations: a model is asked less often, and every plan stays the same to the bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.models.simple import ConstantVelocity, ConstantVelocityProfile
from scex_sumo.drivers.listing import known_entries
from scex_sumo.drivers.registry import build, entry_of, parse_models
from scex_sumo.extrapolation.loop.situations import plan_once, plans_of
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex
from tests.behaviors import roads
from tests.behaviors.test_batches import ROAD, SCENE, history
from tests.learned import nets
from tests.seeds import same_bytes

OURS = [name for name, entry in known_entries().items() if entry.profile is not None and not entry.moves]
NAMES = [*OURS, "sumo:EIDM", "constant_velocity:guard=true", "standard_driver:guard=true"]
RANDOM = [f"{name}:path=random" for name in ("standard_driver", "graph_predictor", "risky_driver:guard=true")]


def alike() -> SceneHistory:
    """Seven futures, of which the second and the fifth, and the third and the last, came to the same."""
    whole = history(7)
    same = np.array([0, 1, 2, 3, 1, 5, 2])
    return replace(whole, states=whole.states[same])


def asked(model: BatchBehavior, whole: SceneHistory, vehicles: VehicleIndex) -> tuple[Plan, Plan]:
    """What the model plans, asked for everybody and asked once for each situation."""
    rng = [np.random.default_rng(c) for c in range(len(whole.futures))]
    return model.plan(whole, ROAD, vehicles, rng), plan_once(model, whole, ROAD, vehicles, rng)


def everybody(whole: SceneHistory) -> VehicleIndex:
    future, vehicle = np.indices(whole.now.shape).reshape(2, -1)
    return VehicleIndex(future=future, vehicle=vehicle)


@pytest.fixture(params=[*NAMES, *RANDOM, "graph_predictor:mode=draw"])
def model(request: pytest.FixtureRequest, tmp_path: Path) -> BatchBehavior:
    name, *rest = request.param.split(":")
    if name in OURS and entry_of(name).may_fail:
        rest.append(f"weights={nets.untrained(tmp_path, name, SCENE, ROAD)}")
    if name == "sumo":
        return build(parse_models(request.param)[0])
    return ModelSet.of(RunSettings(models=":".join([name, *rest]))).built[0]


@pytest.mark.parametrize("whole", [roads.present(SCENE, 7), alike()], ids=["seed", "alike"])
def test_plans_are_the_same_to_the_bit(model: BatchBehavior, whole: SceneHistory) -> None:
    some = everybody(whole)
    for vehicles in (some, VehicleIndex(future=some.future[::3], vehicle=some.vehicle[::3])):
        each, once = asked(model, whole, vehicles)
        assert same_bytes(once, each)
        assert once.reasons == each.reasons
        assert (once.fallback is None) == (each.fallback is None)
        if each.fallback is not None:
            np.testing.assert_array_equal(once.fallback, each.fallback)


@pytest.mark.parametrize("whole", [alike(), history(7)], ids=["alike", "apart"])
def test_models_side_by_side_plan_what_each_plans_alone(whole: SceneHistory, tmp_path: Path) -> None:
    names = ["standard_driver", "risky_driver", "emergency_brake", "constant_velocity:path=-1", "replay"]
    net = nets.untrained(tmp_path, "graph_predictor", SCENE, ROAD)
    names += ["calibrated_driver:guard=true", f"graph_predictor:weights={net}"]
    models = [ModelSet.of(RunSettings(models=name)).built[0] for name in names]
    drawn = np.random.default_rng(3).integers(len(models), size=whole.now.shape)
    groups = [
        VehicleIndex(future=c, vehicle=v) for c, v in (np.nonzero(drawn == m) for m in range(len(models)))
    ]
    groups[2] = VehicleIndex(future=groups[2].future[:0], vehicle=groups[2].vehicle[:0])
    rng = [np.random.default_rng(c) for c in range(len(whole.futures))]
    made = dict(plans_of(models, groups, whole, ROAD, rng))
    assert list(made) == [0, 1, 3, 4, 5, 6]
    for index, plan in made.items():
        alone = models[index].plan(whole, ROAD, groups[index], rng)
        assert same_bytes(plan, alone)


class Counting(ConstantVelocity):
    """Counts the vehicles that it is asked for."""

    def __init__(self) -> None:
        super().__init__(ConstantVelocityProfile())
        self.asked: list[int] = []

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        self.asked.append(len(vehicles))
        return super().plan(history, road, vehicles, rng)


def test_a_users_model_is_asked_for_everybody_even_where_it_takes_after_one_of_ours() -> None:
    model, whole = Counting(), roads.present(SCENE, 7)
    asked(model, whole, everybody(whole))
    list(plans_of([model], [everybody(whole)], whole, ROAD, []))
    assert model.asked == [7 * SCENE.vehicles] * 3
