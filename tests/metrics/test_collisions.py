"""Collisions: closed forms, and shapely's polygons at a thousandth of a step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.rectangles import Rectangles, overlap_area
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, SIDES, find_collisions
from scex_sumo.scene import States
from tests.metrics.straight import closed_forms, straight

FINE = 200  # samples within a step


def test_closed_forms() -> None:
    for case in closed_forms():
        found = find_collisions(straight(case["a"], case["b"]))
        if case["impact_s"] is None:
            assert len(found) == 0, case["name"]
            continue
        assert found.time_s == pytest.approx([case["impact_s"]], abs=1e-9)
        assert found.relative_speed == pytest.approx([case["relative_speed"]], rel=1e-12)
        assert found.kinds().tolist() == [case["kind"]]


def test_who_hits_is_first_in_a_rear_end_collision() -> None:
    tracks = straight({"x": 20, "speed": 5}, {"x": 0, "speed": 15})
    found = find_collisions(tracks)
    assert (found.first[0], found.second[0]) == (1, 0)
    assert SIDES[found.first_side[0]], SIDES[found.second_side[0]] == ("front", "rear")
    assert found.time_s == pytest.approx([1.6], abs=1e-9)
    assert found.step.tolist() == [16]


def test_vehicles_that_pass_through_each_other_between_two_steps_have_collided() -> None:
    """A narrow one crosses at 60 m/s: 6 m a step, through a vehicle 2 m wide."""
    tracks = straight(
        {"x": 0, "length": 2}, {"x": 0, "y": -9, "heading": math.pi / 2, "speed": 60, "length": 1}
    )
    clear = [overlap_of(tracks, step) for step in range(4)]
    assert clear == [0, 0, 0, 0]
    found = find_collisions(tracks)
    assert found.time_s == pytest.approx([(9 - 1 - 0.5) / 60], abs=1e-9)
    assert found.kinds().tolist() == ["side"]


def overlap_of(tracks: SceneTracks, step: int) -> float:
    one, two = (outline(tracks, 0, vehicle, step) for vehicle in (0, 1))
    return float(one.intersection(two).area)


def test_any_overlap_of_simulated_boxes_is_a_collision() -> None:
    """1 mm deep while they pass; 1 mm apart they pass without contact."""
    assert len(find_collisions(straight({"x": -20, "speed": 10}, {"y": 1.999}), limit_m2=CONTACT_M2)) == 1
    assert len(find_collisions(straight({"x": -20, "speed": 10}, {"y": 2.001}), limit_m2=CONTACT_M2)) == 0


def test_the_history_is_not_searched_and_time_counts_from_the_seed_moment() -> None:
    tracks = straight({"x": 0, "speed": 15}, {"x": 20, "speed": 5})
    assert find_collisions(replace(tracks, first=11)).time_s == pytest.approx([0.6], abs=1e-9)
    assert len(find_collisions(replace(tracks, first=20))) == 0


def outline(tracks: SceneTracks, future: int, vehicle: int, at: FloatArray | float) -> shapely.Polygon:
    """Outline at a time in steps, interpolated; at several times, an array of them."""
    x, y, turn = (getattr(tracks.states, key)[future, :, vehicle] for key in ("x", "y", "heading"))
    x, y, turn = (np.interp(at, np.arange(len(x)), values) for values in (x, y, np.unwrap(turn)))
    ahead = tracks.length[vehicle] / 2 * np.stack([np.cos(turn), np.sin(turn)], -1)
    left = tracks.width[vehicle] / 2 * np.stack([-np.sin(turn), np.cos(turn)], -1)
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return shapely.polygons(np.stack([np.stack([x, y], -1) + a * ahead + b * left for a, b in corners], -2))


def crowd(seed: int, futures: int = 4, vehicles: int = 12, steps: int = 12) -> SceneTracks:
    """Vehicles that turn and change speed within a small area."""
    rng = np.random.default_rng(seed)
    shape = (futures, steps, vehicles)
    speed = rng.uniform(0, 25, (futures, 1, vehicles)) + np.cumsum(rng.normal(0, 0.5, shape), axis=1)
    heading = rng.uniform(-math.pi, math.pi, (futures, 1, vehicles))
    heading = heading + np.cumsum(rng.normal(0, 0.15, shape), axis=1)
    where: list[FloatArray] = [
        rng.uniform(0, 35, (futures, 1, vehicles)) + np.cumsum(0.1 * speed * f(heading), axis=1)
        for f in (np.cos, np.sin)
    ]
    return SceneTracks(
        states=States(x=where[0], y=where[1], heading=heading, speed=speed),
        length=rng.uniform(1, 9, vehicles),
        width=rng.uniform(0.5, 2.5, vehicles),
        first=1,
    )


@pytest.mark.parametrize("seed", range(3))
def test_random_motion_collides_as_polygons_at_fine_steps_do(seed: int) -> None:
    tracks = crowd(seed)
    found = find_collisions(tracks)
    got = {
        (int(c), *sorted((int(i), int(j)))): float(t)
        for c, i, j, t in zip(found.future, found.first, found.second, found.time_s, strict=True)
    }
    futures, steps, vehicles = tracks.states.shape
    times = np.arange((steps - 1) * FINE + 1) / FINE
    expected: dict[tuple[int, ...], float] = {}
    for future in range(futures):
        outlines = [outline(tracks, future, vehicle, times) for vehicle in range(vehicles)]
        for i in range(vehicles):
            for j in range(i + 1, vehicles):
                area = shapely.area(shapely.intersection(outlines[i], outlines[j]))
                if area[0] > 0.1 or not (area > 0.1).any():
                    continue
                hit = int(np.argmax(area > 0.1))
                apart = np.flatnonzero(area[:hit] == 0)
                expected[future, i, j] = times[apart[-1] + 1 if apart.size else hit] / 10
    assert len(expected) >= 5
    assert got.keys() == expected.keys()
    for key, time in expected.items():
        assert got[key] == pytest.approx(time, abs=0.1 / FINE + 1e-9)


def test_overlaps_are_those_of_polygons() -> None:
    rng = np.random.default_rng(5)
    tracks = replace(crowd(5, futures=1, vehicles=60, steps=1), first=0)
    states = tracks.states
    one, two = rng.integers(0, 60, (2, 2000))
    # Aligned ones too: edges on edges.
    heading = np.where(rng.random(60) < 0.5, 0.0, states.heading[0, 0])
    tracks = replace(
        tracks, states=replace(states, heading=heading[None, None], x=states.x / 4, y=states.y / 4)
    )
    polygons = np.array([outline(tracks, 0, vehicle, 0) for vehicle in range(60)])

    def take(index: FloatArray) -> Rectangles:
        return Rectangles.of(tracks.states[0, 0, index], tracks.length[index], tracks.width[index])

    expected = shapely.area(shapely.intersection(polygons[one], polygons[two]))
    assert overlap_area(take(one), take(two)) == pytest.approx(expected, abs=1e-6)
