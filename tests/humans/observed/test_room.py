"""Room: distances to the bounds of the lane at places on paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.behaviors.driving.paths import BEHIND_M, FIRST_HORIZON_S, seed_paths
from scex_sumo.humans.lines.driven_line import redrawn
from scex_sumo.humans.observed.observations import room_at
from tests.behaviors import roads


def test_room_at_a_place_on_a_path_is_that_of_the_lane_there_and_none_beyond_the_lanes() -> None:
    line, up = np.array([(0.0, 0.0), (120.0, 0.0)]), np.array([0.0, 5.0])
    lane = replace(roads.lane(1, line), left_bound=line + up, right_bound=line - 0.4 * up)
    road = roads.road(lane)
    paths = seed_paths(roads.scene_of((100.0, 0.0, 0.0, 10.0)), road, FIRST_HORIZON_S, redrawn)
    assert room_at(road, paths, np.array([BEHIND_M])) == pytest.approx(np.array([[5.0, 2.0]]), abs=0.1)
    assert room_at(road, paths, np.array([BEHIND_M + 30.0])) == pytest.approx(0.0)
