"""Fit of the scene model, on scenes whose law is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_context import demands, lane_cells, placed_on_lanes
from scex_sumo.generators.scene_model import KINDS, SceneModel
from scex_sumo.learned.training.scenes import (
    bin_numbers,
    bins_of,
    bounds_of,
    fit,
    known_scenes,
    scene_samples,
    seen_cells,
)
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from tests.converters.maps import straight, write_map
from tests.seeds import straight_seed

pytest.importorskip("torch")


def test_a_frequent_value_has_a_bin_of_its_own_and_the_rest_equal_shares() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([np.zeros(500), rng.uniform(1.0, 5.0, 1500), [np.nan]])
    bins = bins_of(values)
    assert bins[0].tolist() == [0.0, 0.0] and (bins[1:, 1] > bins[1:, 0]).all()
    number = bin_numbers(values, bins)
    assert (number[:500] == 0).all() and number[-1] == -1
    rest = number[500:-1]
    assert ((bins[rest, 0] <= values[500:-1]) & (values[500:-1] <= bins[rest, 1])).mean() > 0.99
    share = np.bincount(rest, minlength=len(bins))[5:-5] / 1500
    assert share == pytest.approx(0.05, abs=0.01)


def platoon(road: Road, rng: np.random.Generator) -> SeedScene:
    """Three vehicles at one random speed, 1 s apart, on the left lane of two."""
    import dataclasses

    speed = rng.choice([5.0, 12.0])
    seed = straight_seed(3, speed)
    h = seed.history
    x = h.x + 60.0 + rng.uniform(0, 60) - (np.arange(3) * (speed + 4.5))[:, None]
    y = np.full_like(x, 5.25)
    history = dataclasses.replace(h, x=x, y=y)
    return dataclasses.replace(seed, history=history, road=road, track_ids=np.arange(3))


def test_the_fit_learns_lane_speed_and_gap(tmp_path: Path) -> None:
    road = read_road(write_map(tmp_path / "road.osm", [straight(1, 0, 200), straight(2, 0, 200, y=3.5)]))
    rng = np.random.default_rng(0)
    scenes = [[platoon(road, rng) for _ in range(count)] for count in (100, 20)]
    inside = seen_cells(scenes[0])
    parts = [scene_samples(some, inside, 0, rng) for some in scenes]
    wholes = [placed_on_lanes(scene, KINDS, rng)[0] for scene in scenes[0]]
    known = [known_scenes(lane_cells(road), inside, wholes)]
    assert parts[0] is not None and parts[1] is not None
    tensors, _ = fit(parts[0], parts[1], known, epochs=6)
    model = SceneModel(
        tensors=tensors,
        meta={"bounds": {"deceleration": 3.0, **dict.fromkeys(demands(lane_cells(road), wholes[0]), 9.0)}},
    )
    speeds, left, seen = [], [], np.isin(np.arange(len(lane_cells(road).cell_lane)), inside)
    for k in range(8):
        scene = generated_scene(road, model, vehicles=3, number=k, cells=seen)
        placed, _ = placed_on_lanes(scene, KINDS, rng)
        speeds.append(placed.speed)
        left += lane_cells(road).poses(placed.lane, placed.s)[1].tolist()
    assert np.mean(np.abs(np.array(left) - 5.25) < 0.5) > 0.9  # the recorded lane
    assert np.mean(np.ptp(speeds, axis=1) < 1.0) > 0.7  # vehicles of one scene have one speed
    assert {round(v) for v in np.concatenate(speeds)} == {5, 12}


def test_bounds_are_those_of_nearly_all_recorded_vehicles_but_no_car_slides() -> None:
    values = np.arange(1001.0)
    cut, kept = (bounds_of({"over_limit": [values / 100], "lateral": [values * k]}) for k in (0.01, 0.001))
    assert cut == {"over_limit": pytest.approx(9.95), "lateral": 4.5}
    assert kept["lateral"] == pytest.approx(0.995)
