"""The drivable surface: rooms beside paths that one can read off a drawing."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.driving.paths import BEHIND_M, seed_paths
from scex_sumo.learned.inputs.surface import CELL_M, path_room, surface_of
from tests.behaviors import roads

TWO = roads.road(
    roads.lane(1, [(0.0, 0.0), (200.0, 0.0)], left=2), roads.lane(2, [(0.0, 3.5), (200.0, 3.5)], right=1)
)
OVER = 1.5 * CELL_M  # the edge is known to a cell, bilinear between cells


def test_depth_is_the_distance_to_the_edge_inside_and_its_negative_outside() -> None:
    surface = surface_of(TWO)
    y = np.array([0.0, 1.75, 3.5, 5.25, 7.0, -3.0])
    assert surface.at(np.full(6, 100.0), y) == pytest.approx([1.75, 3.5, 1.75, 0, -1.75, -1.25], abs=OVER)


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
