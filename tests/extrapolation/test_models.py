"""Models of the vehicles, with and without vehicles under test; models are tried before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import ScexError
from scex_sumo.drivers.decorators import behavior
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.plug_in.fallback import Fallible
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex
from tests.behaviors import roads

TRACKS = np.array([17, 23, 42])


class Parked:
    """Stays where it is; says that it cannot for vehicles in `not_for`."""

    def __init__(self, *, not_for: int = -1) -> None:
        self.not_for = not_for

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        if (vehicles.vehicle == self.not_for).any() or self.not_for == 99:
            raise LookupError("nowhere to park")
        now = history.now[vehicles.future, vehicles.vehicle]
        x, y, heading = (np.repeat(a[:, None], 30, axis=1) for a in (now.x, now.y, now.heading))
        return Plan(x=x, y=y, heading=heading, speed=np.zeros_like(x))


@pytest.fixture(autouse=True)
def parked(registered_models: dict[str, object]) -> None:
    behavior("parked")(Parked)


def models_of(models: str, **settings: Any) -> ModelSet:
    return ModelSet.of(RunSettings(models=models, **settings))


@pytest.mark.parametrize("count", [20, None])
def test_all_others_have_the_models_that_they_have_without_the_one_under_test(count: int | None) -> None:
    models = "standard_driver,risky_driver,constant_velocity"

    def drawn(under_test: dict[int, str | None]) -> np.ndarray:
        built = models_of(models, assign={42: "emergency_brake"}, under_test=under_test)
        return built.draw(SCENE, futures=count, seed=3)

    tested, baseline = drawn({17: "parked"}), drawn({17: None})
    assert np.array_equal(tested[:, 1], baseline[:, 1])
    assert len(set(baseline[:, 0])) == 3 and len(set(tested[:, 0])) == 1
    # The fixed vehicle has the same model, at whatever index.
    assert len(set(tested[:, 2])) == len(set(baseline[:, 2])) == 1


def test_a_model_of_ones_own_that_is_assigned_is_under_test() -> None:
    assign = {17: "parked", 23: "standard_driver"}
    compared = RunSettings(assign=assign)
    assert (compared.assign, compared.under_test) == ({23: "standard_driver"}, {17: "parked"})


def test_only_models_that_may_fail_are_stood_in_for() -> None:
    plain, own, guarded = models_of("standard_driver,parked,parked:guard=true").built
    assert not isinstance(plain, Fallible)
    assert isinstance(own, Fallible)
    assert isinstance(guarded, Guarded) and isinstance(guarded.inner, Fallible)


def test_objects_drive_where_a_name_does() -> None:
    mine, other = Parked(), Parked(not_for=3)
    assigned = RunSettings(models=[mine, "standard_driver"], assign={23: other}, under_test={17: mine})
    built = ModelSet.of(assigned)
    assert built.names == ("Parked", "standard_driver", "Parked:not_for=3")
    assert built.fixed == {17: 0, 23: 2}
    assert built.tested == {17: "Parked", 23: "Parked:not_for=3"}  # a user's model is under test
    described = built.to_json()
    assert described["models"][0] == {"model": "Parked", "weight": 1.0}
    assert set(described["objects"]) == set(described["sources"]) == {"Parked", "Parked:not_for=3"}


SCENE = replace(
    roads.scene_of((10.0, 0.0, 0.0, 5.0), (60.0, 0.0, 0.0, 5.0), (90.0, 0.0, 0.0, 5.0)),
    track_ids=TRACKS,
    road=roads.straight(),
)


def tried(models: str, assign: dict[int, str]) -> None:
    models_of(models, assign=assign).try_on(SCENE, seed=0)


def test_a_model_without_any_usable_plan_is_refused_before_the_run() -> None:
    with pytest.raises(
        ScexError,
        match=r"^parked:not_for=99: no usable plan for any of 3 vehicles of the seed scene: "
        r"raised LookupError: nowhere to park \(test_models.py, line \d+\); "
        r"it is class Parked of .*test_models.py; a Plan has",
    ):
        tried("standard_driver,parked:not_for=99", {})
