"""What a vehicle sees."""

from __future__ import annotations

import numpy as np

from scex_sumo.behaviors.driving.perception import everyone, narrow_road
from scex_sumo.scene import Obstacles, States
from tests.behaviors import roads


def test_obstacles_are_further_columns_seen_while_present() -> None:
    shape = (2, 11)
    walkers = Obstacles(
        ids=("P1", "P2"),
        types=("pedestrian/bicycle",) * 2,
        length=np.array([0.5, 0.6]),
        width=np.array([0.5, 0.6]),
        states=States(
            x=np.full(shape, 12.0), y=np.full(shape, 1.0), heading=np.zeros(shape), speed=np.zeros(shape)
        ),
        present=np.array([[True] * 11, [False] * 11]),
    )
    scene = roads.scene_of((10.0, 0.0, 0.0, 8.0), obstacles=walkers)
    all_of_them = everyone(roads.present(scene))
    assert all_of_them.states.x[0, 1] == 12.0 and all_of_them.states.y[0, 1] == 1.0
    assert all_of_them.present.tolist() == [[True, True, False]]
    assert all_of_them.obstacle.tolist() == [False, True, True]
    assert all_of_them.length.tolist() == [4.5, 0.5, 0.6]


def test_the_map_can_be_narrowed_to_what_is_near() -> None:
    fork = roads.fork()
    assert sorted(narrow_road(fork, 0.0, 0.0, 10.0).lanes) == [1]
    assert sorted(narrow_road(fork, 50.0, 0.0, 5.0).lanes) == [1, 11, 12, 13]
