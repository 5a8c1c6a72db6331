"""Lane changes that begin after three seconds: once wished for, and once the lane beside is free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.humans.driver import LikelyDriver, LikelyProfile
from scex_sumo.humans.parameters import HumanParameters, human_parameters
from tests.behaviors import roads

HUMAN = human_parameters()
ALL_WISH = replace(HUMAN, later_rate=1e3)
FUTURES, ME = 4, (20.0, 0.0, 0.0, 12.0)


def across(*others: roads.Vehicle, human: HumanParameters = ALL_WISH, lanes: int = 2) -> FloatArray:
    """Return (C, 100) places of the first vehicle across a road with one or two lanes, m."""
    two = roads.road(
        roads.lane(1, [(0.0, 0.0), (600.0, 0.0)], left=2), roads.lane(2, [(0.0, 3.5), (600.0, 3.5)], right=1)
    )
    where, scene = (two if lanes == 2 else roads.straight()), roads.scene_of(ME, *others)
    draw = np.random.default_rng(0).random((FUTURES, scene.vehicles))
    model = LikelyDriver(LikelyProfile(inattention=0.0), human)
    return roads.closed_loop(model, where, scene, steps=100, replan=5, futures=FUTURES, draw=draw).y[:, 0]


def test_who_wishes_to_changes_after_three_seconds_and_not_before() -> None:
    wish, keep = across(), across(human=replace(HUMAN, later_rate=1e-6))
    assert (wish[:, :30] == keep[:, :30]).all()
    moved = wish - keep
    assert np.abs(moved[:, -1] - 3.5).max() < 0.3
    assert np.diff(moved, axis=1).max() < 0.13  # 1.875 times the mean speed of 3.5 m in 6.6 s, and a third


def test_nobody_changes_to_a_lane_that_is_not_there_or_into_a_vehicle_beside() -> None:
    keep = across(human=replace(HUMAN, later_rate=1e-6))
    assert np.abs(across(lanes=1) - keep).max() < 0.5
    row = [(x, 3.5, 0.0, 12.0) for x in (4.0, 13.0, 22.0, 31.0, 40.0)]
    assert across(*row)[:, 60].max() < 0.5 < across()[:, 60].min()
