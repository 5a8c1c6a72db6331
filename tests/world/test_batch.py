"""Shared vehicles: SUMO holds one vehicle for all that took the same way, and more when they part."""

from __future__ import annotations

import numpy as np

from scex_sumo.world.batch import SharedVehicles

ALIKE = np.array([0, 1, 0, 1, 0, 1])  # two vehicles in three futures


def test_futures_that_are_alike_share_their_vehicles() -> None:
    known = SharedVehicles(ALIKE)
    assert known.split([np.array([5.0, 7.0, 5.0, 7.0, 5.0, 7.0])]).tolist() == [0, 1]
    assert known.held[known.place].tolist() == [0, 1, 0, 1, 0, 1]


def test_vehicles_that_part_are_held_apart_for_good_even_where_they_meet_again() -> None:
    known = SharedVehicles(ALIKE)
    known.split([np.zeros(6)])
    assert known.split([np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])]).tolist() == [4]
    assert known.split([np.zeros(6)]).tolist() == []
    assert known.held[known.place].tolist() == [0, 1, 0, 1, 4, 1]
