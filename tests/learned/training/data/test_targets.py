"""Targets by hand: on a straight and on a circular road, and for vehicles that were put off."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.learned.training.data.perturb import Perturbation, moved, perturbed
from scex_sumo.learned.training.data.targets import RETURN_M, smooth_return
from scex_sumo.scene import States


def _track(x: list[float], y: list[float], heading: float, speed: float) -> States:
    points = len(x)
    return States(
        x=np.array([x]),
        y=np.array([y]),
        heading=np.full((1, points), heading),
        speed=np.full((1, points), speed),
    )


def test_a_track_is_shifted_to_its_left_and_keeps_its_length() -> None:
    north = _track([0.0, 0.0, 0.0], [-2.0, -1.0, 0.0], np.pi / 2, 10.0)
    off = moved(north, np.array([0.5]), np.array([0.0]))
    np.testing.assert_allclose(off.x, [[-0.5, -0.5, -0.5]], atol=1e-12)  # left of north is west
    np.testing.assert_allclose(off.y, north.y, atol=1e-12)


def test_a_track_turns_about_its_present_place_with_its_past() -> None:
    east = _track([-2.0, -1.0, 0.0], [0.0, 0.0, 0.0], 0.0, 10.0)
    off = moved(east, np.array([0.0]), np.array([np.pi / 2]))
    np.testing.assert_allclose(off.x, [[0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(off.y, [[-2.0, -1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(off.heading, np.pi / 2)


def test_vehicles_are_put_off_within_the_bounds() -> None:
    zero = np.zeros((500, 11))
    still = States(x=zero, y=zero, heading=zero, speed=zero)
    off = perturbed(still, Perturbation(lateral_m=0.7, heading_rad=0.1), np.random.default_rng(0))
    now = off[:, -1]
    assert np.abs(now.y).max() <= 0.7
    assert np.abs(now.heading).max() <= 0.1
    # uniform: the mean of |u| is half the bound, 500 draws stay within 10 % of it
    assert np.abs(now.y).mean() == pytest.approx(0.35, rel=0.1)


def test_the_way_back_begins_where_the_vehicle_is_and_heads() -> None:
    way = np.linspace(0.0, 40.0, 4001)[None]
    back = smooth_return(np.array([0.7]), np.array([0.1]), np.array([10.0]), way)[0]
    assert back[0] == pytest.approx(0.7)
    assert (back[1] - back[0]) / 0.01 == pytest.approx(0.1, abs=1e-3)  # one step of 1 cm of a smooth curve


def test_the_way_back_ends_on_the_recorded_track_and_along_it() -> None:
    way = np.array([[24.99, 25.0, 30.0]])  # 2.5 s at 10 m/s
    back = smooth_return(np.array([-0.7]), np.array([0.0]), np.array([10.0]), way)[0]
    np.testing.assert_allclose(back, 0.0, atol=1e-6)


def test_one_who_stands_does_not_move_sideways() -> None:
    back = smooth_return(np.array([0.7]), np.array([0.08]), np.array([0.0]), np.zeros((1, 30)))[0]
    np.testing.assert_allclose(back, 0.7)


def test_one_who_is_slow_takes_a_dozen_metres() -> None:
    way = np.array([[RETURN_M / 2, RETURN_M]])
    back = smooth_return(np.array([1.0]), np.array([0.0]), np.array([0.5]), way)[0]
    np.testing.assert_allclose(back, [0.5, 0.0], atol=1e-12)  # the quintic is symmetric about its middle
