"""Forecasts of pairs: events as in a run, of futures and of recordings alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from scex_sumo.extrapolation.loop.measure import measure_outcome, measure_recorded
from scex_sumo.extrapolation.loop.rollout import Rollout
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.scene import SeedScene, States
from scex_sumo.studies.validate.vehicles import pair_forecasts
from tests.behaviors import roads
from tests.seeds import going_on

STEPS = 30


def driven(scene: SeedScene, *speeds: float) -> Encounters:
    """Futures straight on: the first vehicle at one of the speeds, the second one as in the scene."""
    time_s = 0.1 * np.arange(1, 2 * STEPS + 1)
    begins = [replace(scene.now, speed=np.array([speed, scene.now.speed[1]])) for speed in speeds]
    plans = States.concatenate([going_on(begin, time_s)[None] for begin in begins], axis=0)  # (C, V, T)
    rollout = Rollout(
        states=plans[:, :, :STEPS].swapaxes(1, 2),
        plan_x=plans.x[:, None],
        plan_y=plans.y[:, None],
        replan=STEPS,
    )
    return measure_outcome(scene, rollout).encounters


def forecast(recorded_mps: float, gap_m: float = 25.0, judged: tuple[bool, bool] = (True, True)) -> pa.Table:
    """Forecasts of a vehicle at 10 m/s (one future: 4 m/s) behind a standing one, both 4.5 m long."""
    scene = roads.scene_of((10.0, 0.0, 0.0, 10.0), (14.5 + gap_m, 0.0, 0.0, 0.0))
    now = replace(scene.now, speed=np.array([recorded_mps, 0.0]))
    recorded = going_on(now, 0.1 * np.arange(1, STEPS + 1))
    whole = np.ones((2, STEPS), dtype=bool)
    scene = replace(scene, road=roads.straight(), future=recorded, future_valid=whole)
    happened = measure_recorded(scene, STEPS)
    assert happened is not None
    return pair_forecasts(
        scene,
        driven(scene, 10.0, 10.0, 10.0, 4.0),
        driven(scene, 10.0),
        happened.encounters,
        np.array(judged),
        futures=4,
    )


@pytest.mark.parametrize(("recorded_mps", "happened"), [(10.0, False), (8.0, True), (2.0, False)])
def test_events_of_pairs_are_shares_of_futures_beside_what_happened(
    recorded_mps: float, happened: bool
) -> None:
    """At 10 m/s the first vehicle is 1 s from the standing one after 1.5 s, at 8 m/s after 2.1 s.

    At 10 m/s it hits it after 2.5 s: recorded boxes that touch are inexact.
    """
    rows = forecast(recorded_mps).to_pylist()
    if recorded_mps == 10.0:
        assert rows == []
        return
    (row,) = rows
    assert row["ttc_forecast"] == row["drac_forecast"] == 0.75
    assert row["ttc_straight"] and row["drac_straight"]
    assert row["ttc_happened"] is row["drac_happened"] is happened


def test_only_judged_pairs_count_that_come_within_10_m_in_some_future() -> None:
    assert len(forecast(2.0, gap_m=39.0)) == 1 and not len(forecast(2.0, gap_m=41.0))
    assert not len(forecast(2.0, judged=(True, False)))
