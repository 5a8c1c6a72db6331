"""A run in which people decide for themselves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.results.tables.cut_sets import cut_set_words
from scex_sumo.scene import SeedScene
from tests.behaviors import roads
from tests.results.test_participants import scene_with
from tests.seeds import people_of, steady


@pytest.fixture(scope="module")
def scene() -> SeedScene:
    """Two cars, and two people that walk along in front of the first one, 5 m beside it."""
    cars = roads.scene_of((5.0, 0.0, 0.0, 5.5), (60.0, 0.0, 0.0, 8.0))
    return replace(
        cars,
        track_ids=np.array([0, 1]),
        road=roads.straight(),
        obstacles=scene_with("pedestrian", "pedestrian").obstacles,
    )


def run_of(scene: SeedScene, out: Path, **options: object) -> scex.Run:
    settings = {"out": out, "futures": 20, "reference": "none", "report": False, **options}
    return scex.extrapolate(scene, **settings)  # type: ignore[arg-type]


def test_people_count_in_pairs_with_vehicles_only(scene: SeedScene, tmp_path: Path) -> None:
    run = run_of(scene, tmp_path / "one", vru="model", models="constant_velocity,steps_out")
    assert run.info["people"] == {"bicycle": {"steps_out": 1.0}, "pedestrian": {"steps_out": 1.0}}
    assert run.info["seed_scene"]["people"] == [2, 3]
    # Whoever steps out is hit by the car that keeps its speed; the two are no pair.
    assert run.collision.value == 1.0
    pairs = set(zip(*(run.collisions[name].to_pylist() for name in ("track_id", "other_id")), strict=True))
    assert pairs and all(min(pair) < 2 for pair in pairs)
    again = run_of(scene, tmp_path / "two", vru="model", models="constant_velocity,steps_out")
    assert run.metrics.equals(again.metrics)


def test_notes_on_people_are_shown(scene: SeedScene, tmp_path: Path) -> None:
    assert scene.obstacles is not None
    sized = replace(scene, obstacles=replace(scene.obstacles, length=np.zeros(2)))
    with pytest.warns(scex.ScexWarning, match="people without a usable size have the usual one: P0, P1"):
        run_of(sized, tmp_path / "one", vru="model", models="constant_velocity", futures=2)


def test_a_driver_that_sees_who_steps_out_brakes(scene: SeedScene, tmp_path: Path) -> None:
    shares = [
        run_of(scene, tmp_path / model, vru="model", models=f"{model},steps_out").collision.value
        for model in ("constant_velocity", "likely_driver")
    ]
    assert shares[1] < 0.5 * shares[0]


def test_what_people_do_counts(scene: SeedScene, tmp_path: Path) -> None:
    """The first car hits whoever steps out if it keeps its speed; nobody else decides it."""
    mix = "constant_velocity@1,emergency_brake@1,steps_out@1,stops@1"
    run = run_of(scene, tmp_path / "run", vru="model", models=mix, futures=96, world="plain")
    pair = run.encounter(0, 2)
    count = pair.collision.count
    assert cut_set_words(pair.row) == [
        f"in {count} of {count} futures in which 0 keeps its speed and 2 steps out"
    ]


def test_a_driver_moves_aside_for_a_cyclist_towards_a_metre(tmp_path: Path) -> None:
    """The cyclist rides 1.9 m beside the way of the car, which leaves 0.65 m between the boxes."""
    car = roads.scene_of((20.0, 0.0, 0.0, 9.0))
    rides = steady((30.0, -1.9, 0.0, 4.0), time_s=0.1 * np.arange(-10, 31))
    cyclist = people_of(rides, "bicycle", length=1.8, width=0.7)
    scene = replace(car, track_ids=np.array([0]), road=roads.straight(), obstacles=cyclist)
    options = {"vru": "model", "futures": 2, "models": "likely_driver:spread=0:inattention=0,keeps_way"}
    states = run_of(scene, tmp_path / "run", **options).states(0)
    beside = np.abs(states.x[0] - states.x[1]) < 2.0
    gap = np.abs(states.y[0] - states.y[1]) - (car.width[0] + 0.7) / 2
    assert gap[0] == pytest.approx(0.65)
    assert 0.85 < gap[beside].min() < gap[beside].max() < 1.05  # it comes over within some seconds
