"""What a vehicle sees."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.driving.perception import local_view, narrow_road
from scex_sumo.scene import Obstacles, States, Who
from tests.behaviors import roads


def test_others_appear_ahead_and_to_the_left_in_own_coordinates() -> None:
    # Facing +y at (10, 20): one 30 m ahead on the same course, one 5 m to the left coming across from it.
    scene = roads.scene_of((10.0, 20.0, np.pi / 2, 8.0), (10.0, 50.0, np.pi / 2, 6.0), (5.0, 20.0, 0.0, 4.0))
    view = local_view(roads.present(scene, 2), Who(child=np.array([1]), vehicle=np.array([0])), radius=29.0)
    assert view.x[0, 1:] == pytest.approx([30.0, 0.0])
    assert view.y[0, 1:] == pytest.approx([0.0, 5.0])
    assert view.heading[0, 1:] == pytest.approx([0.0, -np.pi / 2])
    assert view.vx[0, 1:] == pytest.approx([6.0, 0.0])
    assert view.vy[0, 1:] == pytest.approx([0.0, -4.0])
    # Not itself, and not what is beyond the radius.
    assert view.seen.tolist() == [[False, False, True]]


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
    view = local_view(roads.present(scene), Who(child=np.array([0]), vehicle=np.array([0])))
    assert view.x[0, 1] == pytest.approx(2.0) and view.y[0, 1] == pytest.approx(1.0)
    assert view.seen.tolist() == [[False, True, False]]
    assert view.length.tolist() == [4.5, 0.5, 0.6]


def test_the_map_can_be_narrowed_to_what_is_near() -> None:
    fork = roads.fork()
    assert sorted(narrow_road(fork, 0.0, 0.0, 10.0).lanes) == [1]
    assert sorted(narrow_road(fork, 50.0, 0.0, 5.0).lanes) == [1, 11, 12, 13]
