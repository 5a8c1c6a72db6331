"""Lane relations measured by hand, and the same matches as the plain matching."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.road import Lane
from scex_sumo.roads.relations import LaneRelations, lane_relations
from tests.behaviors.roads import lane


def relate(*lanes: Lane) -> LaneRelations:
    return lane_relations(lanes)


def lead(relations: LaneRelations, a: int, s_a: float, b: int, s_b: float) -> float:
    """Of a vehicle at s_b on b over one at s_a on a."""
    return float(relations.lead[a, b] + relations.stretch_b[a, b] * s_b - relations.stretch_a[a, b] * s_a)


CHAIN = (
    lane(1, [(0.0, 0.0), (50.0, 0.0)], successors=(2,)),
    lane(2, [(50.0, 0.0), (80.0, 0.0)], successors=(3,)),
    lane(3, [(80.0, 0.0), (200.0, 0.0)]),
)


def test_the_way_to_a_lane_is_the_length_of_the_lanes_before_it() -> None:
    assert relate(*CHAIN).ahead.tolist() == [[0, 50, 80], [np.inf, 0, 30], [np.inf, np.inf, 0]]


def test_a_successor_that_a_map_names_twice_is_no_further_away() -> None:
    twice = lane(1, [(0.0, 0.0), (50.0, 0.0)], successors=(2, 2))
    assert relate(twice, *CHAIN[1:]).ahead.tolist() == relate(*CHAIN).ahead.tolist()


def test_a_lane_that_leads_back_to_itself_knows_how_long_the_round_is() -> None:
    square = [(0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (0.0, 30.0), (0.0, 0.0)]
    ring = [lane(i, square[i : i + 2], successors=((i + 1) % 4,)) for i in range(4)]
    assert relate(*ring).loop.tolist() == [120.0] * 4
    assert relate(*CHAIN).loop.tolist() == [np.inf] * 3


def test_neighbours_are_counted_to_the_left_up_to_two_lanes_away() -> None:
    lanes = [
        lane(i, [(0.0, 3.5 * i), (100.0, 3.5 * i)], left=i + 1 if i < 3 else None, right=i - 1 if i else None)
        for i in range(4)
    ]
    assert relate(*lanes).side.tolist() == [[0, 1, 2, 0], [-1, 0, 1, 2], [-2, -1, 0, 1], [0, -2, -1, 0]]


PARALLEL = (
    lane(1, [(0.0, 0.0), (50.0, 0.0)], successors=(2,), left=3),
    lane(2, [(50.0, 0.0), (150.0, 0.0)], left=4),
    lane(3, [(0.0, 3.5), (50.0, 3.5)], successors=(4,), right=1),
    lane(4, [(50.0, 3.5), (150.0, 3.5)], right=2),
)


def test_the_lead_over_a_vehicle_on_the_next_lane_runs_on_across_the_ends_of_lanes() -> None:
    relations = relate(*PARALLEL)
    assert relations.side[0, 3] == 1
    assert lead(relations, 0, 45.0, 3, 10.0) == 15.0  # at x = 60, seen from x = 45
    assert lead(relations, 3, 10.0, 0, 45.0) == -15.0
    assert lead(relations, 0, 20.0, 2, 12.0) == -8.0


EAST, NORTH = [(-50.0, 0.0), (50.0, 0.0)], [(0.0, -40.0), (0.0, 40.0)]
CROSSING = (replace(lane(1, EAST), conflicts=(2,)), replace(lane(2, NORTH), conflicts=(1,)))


def test_crossing_lanes_meet_where_their_centrelines_cross() -> None:
    meeting = relate(*CROSSING).meeting
    assert meeting[0, 1, 0].tolist() == pytest.approx([50.0, 40.0])
    assert meeting[1, 0, 0].tolist() == pytest.approx([40.0, 50.0])
    assert np.isinf(meeting[0, 1, 1:]).all()
    assert np.isinf(meeting[[0, 1], [0, 1]]).all()


def test_merging_lanes_meet_where_two_vehicles_no_longer_fit_beside_each_other() -> None:
    # At 30 degrees the centrelines are 2.4 m apart 2.4 / sin(30) = 4.8 m before their end; they are sampled
    # every 0.25 m.
    start = (100.0 - 50.0 * np.cos(np.pi / 6), -25.0)
    into = [
        replace(lane(1, [(0.0, 0.0), (100.0, 0.0)], successors=(3,)), conflicts=(2,)),
        replace(lane(2, [start, (100.0, 0.0)], successors=(3,)), conflicts=(1,)),
        lane(3, [(100.0, 0.0), (150.0, 0.0)]),
    ]
    assert relate(*into).meeting[0, 1, 0].tolist() == pytest.approx([95.2, 45.2], abs=0.25)
