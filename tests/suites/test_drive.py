"""Futures of a case: which vehicle the function drives, the draws of the others, P and its parts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import ScexError
from scex_sumo.drivers.registry import model_specs
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex
from scex_sumo.suites.drive import PEOPLE, Driven, drive
from tests.decision.families import behind_slower, crossing, pairs, person, scene, street
from tests.seeds import Straight

FUTURES = 16
SLOWER = behind_slower(12.0, 6.0, 10.0)


class Drawing(Straight):
    """The same, and draws random numbers for nothing."""

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        for generator in rng:
            generator.random(99)
        return super().plan(history, road, vehicles, rng)


class Lost(Straight):
    """Plans nothing that can be used after half a second."""

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        plan = super().plan(history, road, vehicles, rng)
        plan.x[:] = np.nan if history.step else plan.x
        return plan


@cache
def driven(function: Any = None, track_id: int = 1) -> Driven:
    return drive(SLOWER, track_id, function and model_specs(function)[0], FUTURES, seed=0)


def test_a_blind_function_collides_more_often_than_people_and_one_that_brakes_less() -> None:
    blind, people, brakes = (
        driven(one).contacts.probability for one in ("constant_velocity", None, "emergency_brake")
    )
    assert blind > 0.5 > 10 * people
    assert people >= brakes
    assert driven("constant_velocity").collides.mean() > 0.5  # from some a faster leader drives away


def test_people_have_the_probability_of_the_ranking() -> None:
    table = pairs(SLOWER, FUTURES).to_pylist()
    assert driven().row_of(2)["probability"] == pytest.approx(table[0]["probability"], rel=1e-9)
    assert driven().row_of(2)["how"] == table[0]["how"]


def test_the_human_like_driver_under_test_is_people() -> None:
    assert np.array_equal(driven(PEOPLE).contacts.by_future, driven().contacts.by_future)


def test_the_draws_of_others_do_not_depend_on_the_function() -> None:
    one, other = driven(Straight()), driven(Drawing())
    assert np.array_equal(one.states.x, other.states.x)
    assert len(set(one.states.x[:, 1, -1].tolist())) > 1  # the other one is drawn


def test_the_function_drives_the_vehicle_of_the_case_alone() -> None:
    ahead = driven("constant_velocity", track_id=2)
    assert np.allclose(ahead.states.speed[:, 1], 6.0)
    assert ahead.states.speed[:, 0].std() > 0


def test_p_of_a_vehicle_counts_contacts_with_any_other_one() -> None:
    three = scene(
        street(),
        (0.0, 0.0, 0.0, 12.0),
        (14.5, 0.0, 0.0, 6.0),
        (-12.0, 0.0, 0.0, 13.0),
        (-6.0, 3.5, np.pi, 8.0),
    )
    found = drive(three, 1, None, FUTURES, seed=0)
    each = [row["probability"] for row in found.pairs]
    assert len(each) == 3
    assert max(each) < found.contacts.probability
    assert found.contacts_with(2).probability == pytest.approx(found.row_of(2)["probability"], rel=1e-12)
    assert all(1 in (row["track_id"], row["other_id"]) for row in found.pairs)


def test_an_effect_is_what_leaving_a_future_out_changes() -> None:
    found = driven("constant_velocity", track_id=2).contacts
    root = found.root
    without = np.array([np.delete(root, c).mean() ** 3 for c in range(FUTURES)])
    assert found.effects.sum() == pytest.approx(0.0, abs=1e-12)
    assert found.probability - without == pytest.approx(
        found.effects / (FUTURES - 1), abs=0.1 * np.abs(found.effects).max()
    )


def test_people_on_foot_move_as_recorded_and_can_be_hit() -> None:
    found = drive(person(8.0, 2.0), 1, model_specs("constant_velocity")[0], 4, seed=0)
    assert found.pairs[0]["person"] == "pedestrian 900"
    assert found.contacts.probability == pytest.approx(1.0)


def test_another_one_that_never_comes_near_has_a_row_without_words() -> None:
    far = scene(street(), (0.0, 0.0, 0.0, 5.0), (300.0, 0.0, 0.0, 5.0))
    found = drive(far, 1, None, 4, seed=0)
    assert found.pairs == []
    assert (found.row_of(2)["how"], found.contacts.probability) == (None, 0.0)


def test_a_plan_that_cannot_be_used_ends_the_case() -> None:
    with pytest.raises(ScexError, match=r"20 plans cannot be used, the first at 0.5 s: plan.x is not finite"):
        drive(crossing(8.0, 3.0), 1, model_specs(Lost)[0], 4, seed=0)
