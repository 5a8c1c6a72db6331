"""Curves that maps are drawn along."""

from __future__ import annotations

import numpy as np
import pytest

from example_maps.curves import Pose, arc, clothoids, join, smooth_step, stations

ORIGIN = Pose(x=0.0, y=0.0, heading=0.0)


def test_a_quarter_circle_ends_at_its_radius():
    # Left turn of radius 10 m from the origin towards +x: ends in (10, 10), heading up.
    curve = clothoids(ORIGIN, [(5 * np.pi, 0.1, 0.1)])
    end = curve.pose(curve.length)
    assert (end.x, end.y, end.heading) == pytest.approx((10.0, 10.0, np.pi / 2), abs=1e-8)


def test_a_clothoid_follows_the_fresnel_integrals():
    # kappa = s / 100, so heading = s² / 200; cosine and sine of it integrated term by term.
    end = clothoids(ORIGIN, [(10.0, 0.0, 0.1)]).pose(10.0)
    x = 10 - 10**5 / (5 * 2 * 200**2) + 10**9 / (9 * 24 * 200**4) - 10**13 / (13 * 720 * 200**6)
    y = 10**3 / (3 * 200) - 10**7 / (7 * 6 * 200**3) + 10**11 / (11 * 120 * 200**5)
    assert (end.x, end.y, end.heading) == pytest.approx((x, y, 0.5), abs=2e-6)


def test_pieces_follow_each_other_without_a_gap():
    curve = clothoids(ORIGIN, [(10.0, 0.0, 0.0), (10.0, 0.0, 0.05), (10.0, 0.05, 0.05)])
    assert curve.length == pytest.approx(30.0)
    assert np.all(np.diff(curve.s) > 0)
    assert np.abs(np.diff(curve.curvature)).max() < 0.002  # 0.25 m of a clothoid that bends by 0.05 in 10 m


def test_an_arc_keeps_its_distance_from_the_centre():
    curve = arc((3.0, 4.0), 20.0, 0.5, 1.5)
    assert np.hypot(curve.x - 3, curve.y - 4) == pytest.approx(np.full(curve.x.shape, 20.0))
    assert curve.length == pytest.approx(20.0)


def test_an_offset_to_the_left_shortens_a_left_hand_arc():
    curve = arc((0.0, 0.0), 20.0, 0.0, 1.0)
    assert np.hypot(*curve.offset(3.0).T) == pytest.approx(np.full(curve.x.shape, 17.0))


def test_a_join_meets_both_poses_and_curvatures():
    start = Pose(x=0.0, y=0.0, heading=0.0, curvature=0.02)
    end = Pose(x=20.0, y=12.0, heading=1.0, curvature=0.01)
    curve = join(start, end)
    for pose, wanted in ((curve.pose(0.0), start), (curve.pose(curve.length), end)):
        assert (pose.x, pose.y, pose.heading) == pytest.approx((wanted.x, wanted.y, wanted.heading), abs=1e-9)
        assert pose.curvature == pytest.approx(wanted.curvature, abs=1e-9)


def test_a_join_between_two_straight_roads_is_little_sharper_than_an_arc():
    # 90 degrees between tangents of 15 m: the arc has 15 m radius; starting straight costs up to a half more.
    curve = join(ORIGIN, Pose(x=15.0, y=15.0, heading=np.pi / 2))
    assert 1 / 15 < np.abs(curve.curvature).max() < 1.5 / 15


def test_a_join_ends_straight_where_the_next_curve_bends_the_other_way():
    curve = join(ORIGIN, Pose(x=15.0, y=-12.0, heading=-1.2, curvature=0.06))
    assert curve.curvature[-1] == pytest.approx(0.0, abs=1e-9)
    assert curve.curvature.max() < 0.005


def test_a_smooth_step_is_flat_and_straight_at_both_ends():
    s = np.linspace(0, 10, 1001)
    step = smooth_step(s, 2.0, 8.0)
    assert step[s <= 2].max() == 0.0
    assert step[s >= 8].min() == 1.0
    assert step[500] == pytest.approx(0.5)
    slope = np.gradient(step, s)
    assert np.abs(slope[[200, 800]]).max() < 1e-3


def test_stations_keep_a_polyline_near_its_arc():
    # Sagitta of a chord c on radius r: c² / 8r.
    count = stations(30.0, 1 / 15)
    assert (30.0 / (count - 1)) ** 2 / (8 * 15) <= 0.02
    assert stations(100.0, 0.0) == 11
