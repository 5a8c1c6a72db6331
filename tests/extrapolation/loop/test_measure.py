"""What happened is measured like what could have happened."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from scex_sumo.extrapolation.loop.measure import (
    measure_outcome,
    measure_recorded,
    overlapping_at_first,
    recorded_steps_of,
)
from scex_sumo.extrapolation.loop.rollout import Rollout
from scex_sumo.extrapolation.writing import outcome_notes
from scex_sumo.results.tables.outcomes import worst_table
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from tests.seeds import going_on, seed_of, steady

NEXT_S = 0.1 * np.arange(1, 51)


def crossing_seed() -> SeedScene:
    """One eastbound at 10 m/s, 42 m before the crossing; one northbound at 10 m/s, 45 m before it."""
    history = steady((-42.0, 0.0, 0.0, 10.0), (0.0, -45.0, np.pi / 2, 10.0))
    future = {"future": going_on(history[:, -1], NEXT_S), "future_valid": np.ones((2, 50), dtype=bool)}
    return seed_of(history, track_ids=np.arange(2), road=Road(name="empty", lanes={}), **future)


def test_futures_can_be_measured_for_as_long_as_their_vehicles_were_recorded() -> None:
    scene = crossing_seed()
    assert scene.future is not None and scene.future_valid is not None
    valid = scene.future_valid.copy()
    valid[1, 10:] = False
    left = dataclasses.replace(scene, future_valid=valid)
    futures = Rollout(
        states=scene.future[:, :30].repeat(2).swapaxes(1, 2),
        plan_x=np.zeros((2, 6, 2, 30)),
        plan_y=np.zeros((2, 6, 2, 30)),
        replan=5,
    )
    counted = recorded_steps_of(left, 30)
    found = measure_outcome(left, futures, counted=counted).values
    recorded = measure_recorded(left, 30)
    assert recorded is not None
    for name in ("distance", "distance_mean", "wttc"):
        assert found.column(name)[0] == pytest.approx(recorded.values.column(name)[0].repeat(2), abs=1e-9)
    every = measure_outcome(left, futures).values
    assert (every.column("distance")[0] < found.column("distance")[0]).all()  # they go on towards each other


def test_the_worst_moment_is_named_by_its_frame() -> None:
    scene = crossing_seed()
    plan = going_on(scene.now, NEXT_S)
    states = plan[:, :30].swapaxes(0, 1)[None]
    rollout = Rollout(states=states, plan_x=plan.x[None, None], plan_y=plan.y[None, None], replan=30)
    values = measure_outcome(scene, rollout).values
    rows = worst_table(values, futures=np.array([7]), track_ids=scene.track_ids).to_pylist()
    closest = next(row for row in rows if row["metric"] == "distance")
    # They come nearer all the time: the worst step is the last, frame 40 of the case.
    assert closest["future"] == 7
    assert closest["timestamp_ms"] == 4000
    assert {closest["track_id"], closest["other_id"]} == {0, 1}
    assert closest["value"] == pytest.approx(np.hypot(12, 15))


def test_boxes_that_overlap_at_first_and_vehicles_that_leave_are_said() -> None:
    scene = crossing_seed()
    assert overlapping_at_first(scene) == []
    met = dataclasses.replace(scene, length=np.full(2, 60.0), width=np.full(2, 60.0))
    assert overlapping_at_first(met) == [(0, 1)]
    assert scene.future_valid is not None
    valid = scene.future_valid.copy()
    valid[1, 10:] = False
    gone = dataclasses.replace(met, future_valid=valid)
    notes = outcome_notes(gone, measure_recorded(gone, 30))
    assert notes[0] == "boxes that overlap at the seed moment do not count as collisions: 0 and 1"
    assert "1 of 2 vehicles leave within the time of a future" in notes[-1] and notes[-1].endswith(": 1")


def test_a_car_that_hits_one_of_two_people_that_touched_is_no_consequence() -> None:
    """Two people come together 1 s before a car at 10 m/s reaches the first one, 20 m ahead."""
    scene = seed_of(
        steady((0.0, 0.0, 0.0, 10.0), (24.0, 0.0, 0.0, 0.0), (24.0, 1.6, -np.pi / 2, 1.0)),
        types=("car", "pedestrian", "pedestrian"),
        length=np.array([4.0, 0.6, 0.6]),
        width=np.array([2.0, 0.6, 0.6]),
        people=np.array([False, True, True]),
    )
    plan = going_on(scene.now, NEXT_S)
    rollout = Rollout(
        states=plan[:, :30].swapaxes(0, 1)[None],
        plan_x=plan.x[None, None],
        plan_y=plan.y[None, None],
        replan=30,
        with_crashes=True,
    )
    outcome = measure_outcome(scene, rollout, vehicles=(0,))
    assert outcome.collisions.first.tolist() == [0, 0]
    assert not outcome.collisions.consequence.any()
    assert (outcome.severity.p_mais3_other > 0.1).all()
