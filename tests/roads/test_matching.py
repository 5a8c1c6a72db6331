"""Map matching: position and heading decide."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.road import Road
from scex_sumo.roads.matching import Matches, match
from tests.behaviors import roads
from tests.roads.plain_matching import plain_match


def one(where: Road, x: float, y: float, heading: float) -> list[tuple[int, float, float, float]]:
    found = match(where, np.array([x]), np.array([y]), np.array([heading]))
    return list(
        zip(
            found.lane_id.tolist(),
            found.s.tolist(),
            found.offset.tolist(),
            found.probability.tolist(),
            strict=True,
        )
    )


def test_a_vehicle_on_a_lane_gets_its_arc_length_and_its_offset_to_the_left() -> None:
    ((lane_id, s, offset, probability),) = one(roads.straight(), 40.0, 0.5, 0.05)
    assert (lane_id, s, offset, probability) == pytest.approx((1, 40.0, 0.5, 1.0))


def test_on_a_crossing_the_lane_of_the_own_direction_is_by_far_the_most_probable() -> None:
    crossing = roads.road(
        roads.lane(1, [(-50.0, 0.0), (50.0, 0.0)]), roads.lane(2, [(0.0, -50.0), (0.0, 50.0)])
    )
    assert [m[0] for m in one(crossing, 0.0, 0.0, np.pi / 2)] == [2]
    both = one(crossing, 0.0, 0.0, np.deg2rad(35))
    assert [m[0] for m in both] == [1, 2]
    # 35 against 55 degrees at 0.15 rad: exp(-(0.611² - 0.960²) / (2·0.15²)) = 196 000 to 1.
    assert both[0][3] / both[1][3] == pytest.approx(np.exp((0.9599**2 - 0.6109**2) / (2 * 0.15**2)), rel=1e-2)


def test_between_two_parallel_lanes_both_are_equally_probable() -> None:
    parallel = roads.road(
        roads.lane(1, [(0.0, 0.0), (100.0, 0.0)]), roads.lane(2, [(0.0, 3.5), (100.0, 3.5)])
    )
    assert [(m[0], m[3]) for m in one(parallel, 50.0, 1.75, 0.0)] == [
        (1, pytest.approx(0.5)),
        (2, pytest.approx(0.5)),
    ]


def poses(where: Road, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """On the lanes, beside them, across them and a few far away."""
    rng = np.random.default_rng(seed)
    points = np.vstack([one.centreline for one in where.vehicle_lanes.values()])
    x, y = (points[rng.integers(len(points), size=count)] + rng.normal(0, 2.5, (count, 2))).T
    turn = np.concatenate([np.arctan2(*np.diff(one.centreline, axis=0)[0, ::-1])[None]
                           for one in where.vehicle_lanes.values()])  # fmt: skip
    heading = rng.choice(turn, count) + rng.normal(0, 0.4, count)
    x[::50] += 500.0
    return x, y, heading


def same(found: Matches, expected: Matches) -> bool:
    return all(np.array_equal(getattr(found, f.name), getattr(expected, f.name)) for f in fields(Matches))


@pytest.mark.parametrize("name", ["roundabout", "urban_intersection", "motorway_merge"])
def test_matches_are_those_of_the_plain_matching(name: str) -> None:
    where = scex.read_map(scex.example_path(name))
    x, y, heading = poses(where, 600, 0)
    expected = plain_match(where, x, y, heading)
    assert len(expected.vehicle) > 200
    assert same(match(where, x, y, heading), expected)


@pytest.mark.parametrize("name", ["interaction/maps/DR_DEU_Roundabout_OF", "taf_bw/maps/k733_2020-09-15"])
def test_matches_on_real_maps_are_those_of_the_plain_matching(data: Path, name: str) -> None:
    where = scex.read_map(data / f"{name}.osm")
    x, y, heading = poses(where, 600, 1)
    assert same(match(where, x, y, heading), plain_match(where, x, y, heading))
