"""What learned drivers see of the road, on roads drawn by hand."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.learned.inputs.path_inputs import AHEAD_M, PATH_COLUMNS, PathInputs, path_inputs
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, SeedScene
from tests.behaviors import roads


def seen(road: Road, scene: SeedScene | SceneHistory) -> PathInputs:
    history = scene if isinstance(scene, SceneHistory) else roads.present(scene)
    vehicles = roads.every(history)
    return path_inputs(history, road, vehicles, *chosen_paths(history, road, vehicles, "straight"))


def column(inputs: PathInputs, name: str, vehicle: int = 0) -> float:
    return float(inputs.features[vehicle, PATH_COLUMNS.index(name)])


def test_a_vehicle_beside_a_straight_path_and_askew_sees_it_so() -> None:
    askew = 0.1
    inputs = seen(roads.straight(), roads.scene_of((50.0, 0.5, askew, 10.0)))
    assert column(inputs, "offset") == pytest.approx(0.5)
    assert column(inputs, "heading_error") == pytest.approx(askew)
    for ahead in AHEAD_M:
        assert column(inputs, f"x_{ahead:g}") == pytest.approx(np.cos(askew) * ahead - np.sin(askew) * 0.5)
        assert column(inputs, f"y_{ahead:g}") == pytest.approx(-np.sin(askew) * ahead - np.cos(askew) * 0.5)
        assert column(inputs, f"heading_{ahead:g}") == pytest.approx(-askew)
        assert column(inputs, f"curvature_{ahead:g}") == pytest.approx(0.0, abs=1e-9)
        assert column(inputs, f"limit_{ahead:g}") == 15.0


def test_the_path_of_a_curve_turns_as_it_does() -> None:
    curve = roads.road(roads.lane(1, roads.arc(50.0, np.pi)))
    inputs = seen(curve, roads.scene_of((50 * np.sin(1.0), 50 * (1 - np.cos(1.0)), 1.0, 10.0)))
    assert column(inputs, "curvature_20") == pytest.approx(1 / 50, rel=0.02)
    assert column(inputs, "heading_20") == pytest.approx(20 / 50, rel=0.02)
    assert column(inputs, "y_20") == pytest.approx(50 * (1 - np.cos(20 / 50)), rel=0.02)
    # It drove straight so far, where the curve asks for 0.2 rad/s.
    assert column(inputs, "yaw_rate_error") == pytest.approx(-10 / 50, rel=0.02)


def test_a_leader_is_seen_with_its_gap_and_what_stopping_for_it_takes() -> None:
    inputs = seen(roads.straight(), roads.scene_of((50.0, 0.0, 0.0, 12.0), (80.0, 0.0, 0.0, 4.0)))
    gap = 30.0 - 4.5
    wanted = {
        "leader": 1,
        "leader_gap": gap,
        "leader_speed": 4,
        "closing": 8,
        "needed_deceleration": 64 / 2 / gap,
    }
    for name, value in wanted.items():
        assert column(inputs, name) == pytest.approx(value)
    assert column(inputs, "leader", 1) == 0
    assert column(inputs, "leader_gap", 1) == 100
    assert column(inputs, "leader_speed", 1) == 4
    assert column(inputs, "closing", 1) == 0


def test_the_queue_ahead_is_counted_from_the_first_to_the_last_who_stands() -> None:
    queue = [(80.0, 0.0, 0.0, 4.0), (100.0, 0.0, 0.0, 0.0), (110.0, 0.0, 0.0, 0.0)]
    inputs = seen(roads.straight(), roads.scene_of((50.0, 0.0, 0.0, 12.0), *queue))
    wanted = {
        "ahead": 3,
        "ahead_standing": 2,
        "ahead_speed": 4 / 3,
        "first_standing_gap": 50.0 - 4.5,
        "last_standing_gap": 60.0 - 4.5,
    }
    for name, value in wanted.items():
        assert column(inputs, name) == pytest.approx(value)
    nobody = {"ahead": 0, "ahead_standing": 0, "first_standing_gap": 100, "last_standing_gap": 0}
    assert {name: column(inputs, name, 3) for name in nobody} == nobody


def test_features_do_not_depend_on_where_north_is() -> None:
    turn, shift = 2.2, np.array([500.0, -200.0])

    def placed(angle: float, where: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(angle), np.sin(angle)
        spin = np.array([[cos, -sin], [sin, cos]])
        line = roads.arc(40.0, 1.2) @ spin.T + where
        start = spin @ np.array([40 * np.sin(0.3), 40 * (1 - np.cos(0.3))]) + where
        scene = roads.scene_of((*start, 0.3 + angle, 8.0))
        return seen(roads.road(roads.lane(1, line)), scene).features

    turned, plain = placed(turn, shift), placed(0.0, np.zeros(2))
    # The surface is a grid, of which 0.25 m remain in rooms and 2 m in the way to the end.
    coarse = {"room_left": 0.3, "room_right": 0.3, "end": 2.01}
    tolerance = np.array([coarse.get(name, 1e-6) for name in PATH_COLUMNS])
    assert (np.abs(turned - plain) <= tolerance).all()
