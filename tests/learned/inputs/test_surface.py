"""The drivable surface: rooms beside paths that one can read off a drawing."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.driving.paths import BEHIND_M, seed_paths
from scex_sumo.learned.inputs.surface import CELL_M, MAX_ROOM_M, path_room, surface_of
from tests.behaviors import roads

TWO = roads.road(
    roads.lane(1, [(0.0, 0.0), (200.0, 0.0)], left=2),
    roads.lane(2, [(0.0, 3.5), (200.0, 3.5)], right=1),
)
OVER = 1.5 * CELL_M  # the edge is known to a cell, bilinear between cells


def test_depth_is_the_distance_to_the_edge_inside_and_its_negative_outside() -> None:
    surface = surface_of(TWO)
    y = np.array([0.0, 1.75, 3.5, 5.25, 7.0, -3.0])
    assert surface.at(np.full(6, 100.0), y) == pytest.approx([1.75, 3.5, 1.75, 0, -1.75, -1.25], abs=OVER)


def test_a_lane_drawn_as_one_line_has_its_width() -> None:
    assert surface_of(roads.straight()).at(np.array([300.0]), np.zeros(1)) == pytest.approx(1.75, abs=OVER)


def test_a_map_without_vehicle_lanes_has_no_surface() -> None:
    walk = roads.road(roads.lane(1, [(0.0, 0.0), (50.0, 0.0)], kind="pedestrian"))
    assert (surface_of(walk).at(np.array([20.0, 1e4]), np.zeros(2)) < 0).all()


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0, -1.0])
def test_room_on_both_sides_of_a_path_of_any_direction(turn: float) -> None:
    cos, sin = np.cos(turn), np.sin(turn)

    def at(x: float, y: float) -> tuple[float, float]:
        return 1000 + cos * x - sin * y, 500 + sin * x + cos * y

    road = roads.road(
        roads.lane(1, [at(0, 0), at(200, 0)], left=2), roads.lane(2, [at(0, 3.5), at(200, 3.5)], right=1)
    )
    scene = roads.scene_of((*at(50, 0), turn, 10.0))
    room = path_room(seed_paths(scene, road), road)
    left, right = room.at(np.zeros(1, dtype=int), np.array([BEHIND_M + 20.0]))
    assert left == pytest.approx(5.25, abs=OVER)
    assert right == pytest.approx(1.75, abs=OVER)


def test_past_the_end_of_the_map_the_last_room_stays_and_the_end_is_known() -> None:
    scene = roads.scene_of((100.0, 0.0, 0.0, 10.0))
    room = path_room(seed_paths(scene, TWO), TWO)
    assert room.end[0] == pytest.approx(BEHIND_M + 100.0, abs=room.spacing)
    left, _ = room.at(np.zeros(1, dtype=int), np.array([BEHIND_M + 119.0]))
    assert left == pytest.approx(5.25, abs=OVER)


def test_room_has_an_upper_bound() -> None:
    square = roads.road(roads.lane(1, [(0.0, 0.0), (200.0, 0.0)], width=60.0))
    room = path_room(seed_paths(roads.scene_of((50.0, 0.0, 0.0, 5.0)), square), square)
    assert room.left[0, 10] == room.right[0, 10] == MAX_ROOM_M
