"""Forecasts of pairs: events along the driven tracks, of futures and of recordings alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.scene import SeedScene, States
from scex_sumo.studies.validate.vehicles import gap_forecasts
from tests.behaviors import roads

STEPS = 30


def driven(scene: SeedScene, *speeds: float) -> States:
    """(1, T, 2) straight on: the first vehicle at one of the speeds, the second one as in the scene."""
    time = 0.1 * np.arange(1, STEPS + 1)[:, None]
    futures = []
    for speed in speeds:
        v = np.array([speed, scene.now.speed[1]])
        x = scene.now.x + v * time
        level = np.zeros_like(x)
        futures.append(States(x=x[None], y=level[None], heading=level[None], speed=(level + v)[None]))
    return States.concatenate(futures, axis=0)


@pytest.mark.parametrize(("recorded", "happened"), [(10.0, True), (2.0, False)])
def test_pair_events_are_shares_of_futures_beside_what_happened(recorded: float, happened: bool) -> None:
    # 25 m of road between the bumpers: at 10 m/s the first vehicle is 1 s from the standing one after 1.5 s.
    scene = roads.scene_of((0.0, 0.0, 0.0, 10.0), (30.0, 0.0, 0.0, 0.0))
    scene = replace(
        scene,
        future=driven(scene, recorded)[0].map(lambda values: values.T),
        future_valid=np.ones((2, STEPS), dtype=bool),
    )
    futures = driven(scene, 10.0, 10.0, 10.0, 4.0)
    (row,) = gap_forecasts(
        scene, futures, driven(scene, 10.0), driven(scene, recorded),
        np.ones(2, dtype=bool),
    ).to_pylist()  # fmt: skip
    assert row["ttc_forecast"] == row["drac_forecast"] == 0.75
    assert row["ttc_straight"] and row["drac_straight"]
    assert row["ttc_happened"] is row["drac_happened"] is happened
