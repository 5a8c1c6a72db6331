"""Routes over lanes and the candidate paths of vehicles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Lane, Road
from scex_sumo.roads import routes as module
from scex_sumo.roads.routes import candidate_paths, centreline, routes
from tests.behaviors import roads


def test_a_three_way_fork_gives_three_routes_and_only_one_when_it_is_beyond_the_horizon() -> None:
    assert routes(roads.fork(), 1, 10.0, 80.0) == ((1, 11), (1, 12), (1, 13))
    assert routes(roads.fork(), 1, 10.0, 40.0) == ((1,),)


def test_a_roundabout_leads_round_and_out_at_every_exit() -> None:
    ring = roads.arc(12.0, np.pi), roads.arc(12.0, np.pi, (0.0, 24.0), np.pi)
    circle = roads.road(
        roads.lane(1, ring[0], successors=(2, 3)),
        roads.lane(2, ring[1], successors=(1,)),
        roads.lane(3, [(0.0, 24.0), (-50.0, 24.0)]),
    )
    # Half a ring is 37.7 m: in 80 m the exit is passed once and reached again.
    assert routes(circle, 1, 0.0, 80.0) == ((1, 2, 1), (1, 3))
    assert (1, 2, 1, 3) in routes(circle, 1, 0.0, 120.0)


def test_of_too_many_routes_the_nearest_forks_are_told_apart_and_the_last_ones_are_not() -> None:
    """Lanes of 15 m that fork six times in 100 m: 64 routes, of which 32 would lie on the left."""

    def tree(number: int, forks: int) -> list[Lane]:
        ahead = (2 * number, 2 * number + 1) if forks else ()
        begin = 15.0 * number.bit_length()
        own = roads.lane(number, [(begin, number), (begin + 15.0, number)], successors=ahead)
        return [own, *(lane for after in ahead for lane in tree(after, forks - 1))]

    found = routes(roads.road(*tree(1, 6)), 1, 0.0, 100.0)
    assert [route[-1] for route in found] == [*range(32, 64)]
    assert {len(route) for route in found} == {6}


def test_where_a_lane_ends_the_route_goes_on_beside_it_if_changing_is_allowed() -> None:
    def ramp(left: int | None) -> tuple[tuple[int, ...], ...]:
        merge = roads.road(
            roads.lane(1, [(0.0, 0.0), (80.0, 0.0)], left=left),
            roads.lane(2, [(0.0, 3.5), (80.0, 3.5)], successors=(3,), right=1),
            roads.lane(3, [(80.0, 3.5), (300.0, 3.5)], predecessors=(2,)),
        )
        return routes(merge, 1, 10.0, 150.0)

    assert ramp(left=2) == ((1, 2, 3),)
    assert ramp(left=None) == ((1,),)


def test_paths_at_a_fork_are_ordered_from_left_to_right_in_the_vehicles_frame() -> None:
    (paths,) = candidate_paths(roads.fork(), roads.scene_of((20.0, 0.0, 0.0, 10.0)))
    assert [path.lanes for path in paths] == [(1, 11), (1, 12), (1, 13)]
    assert paths[0].angle > 0.5
    assert paths[1].angle == pytest.approx(0.0)
    assert paths[0].angle == pytest.approx(-paths[2].angle)
    assert [path.probability for path in paths] == pytest.approx([1 / 3] * 3)
    assert [path.s for path in paths] == pytest.approx([20.0] * 3)


def test_the_order_does_not_depend_on_where_the_map_points() -> None:
    fork = roads.fork()
    turned = roads.road(
        *(
            roads.lane(
                one.lane_id,
                one.centreline @ np.array([[-1.0, 0.0], [0.0, -1.0]]),
                successors=one.successors,
                predecessors=one.predecessors,
            )
            for one in fork.lanes.values()
        )
    )
    (paths,) = candidate_paths(turned, roads.scene_of((-20.0, 0.0, np.pi, 10.0)))
    assert [path.lanes for path in paths] == [(1, 11), (1, 12), (1, 13)]


def test_probability_is_shared_at_each_fork_not_among_all_ends() -> None:
    tree = roads.road(
        roads.lane(1, [(0.0, 0.0), (30.0, 0.0)], successors=(2, 3)),
        roads.lane(2, [(30.0, 0.0), (50.0, 8.0)], predecessors=(1,), successors=(4, 5)),
        roads.lane(3, [(30.0, 0.0), (120.0, -40.0)], predecessors=(1,)),
        roads.lane(4, [(50.0, 8.0), (120.0, 70.0)], predecessors=(2,)),
        roads.lane(5, [(50.0, 8.0), (120.0, 8.0)], predecessors=(2,)),
    )
    (paths,) = candidate_paths(tree, roads.scene_of((10.0, 0.0, 0.0, 10.0)))
    assert {path.lanes: path.probability for path in paths} == pytest.approx(
        {(1, 2, 4): 0.25, (1, 2, 5): 0.25, (1, 3): 0.5}
    )


def chain_of_forks(count: int) -> Road:
    """Forks every 40 m into two lanes that meet again: lanes 10k and 10k + 1 after the k-th."""
    pieces = []
    for k in range(count):
        begin, end = [(40.0 * k, 0.0), (40.0 * k + 40.0, 0.0)], (10 * k + 10, 10 * k + 11)
        for lane in (10 * k, 10 * k + 1):
            pieces.append(roads.lane(lane, begin, successors=end if k + 1 < count else ()))
    return roads.road(*pieces)


def test_longer_futures_choose_at_forks_that_shorter_ones_do_not_reach() -> None:
    forks, scene = chain_of_forks(4), roads.scene_of((5.0, 0.0, 0.0, 10.0))
    counts = [
        len(candidate_paths(forks, replace(scene, horizon_s=horizon_s))[0]) for horizon_s in (3.0, 5.0, 8.0)
    ]
    assert counts == [8, 8, 16]  # two lanes to begin on; 80, 107 and 147 m
    (paths,) = candidate_paths(forks, replace(scene, horizon_s=8.0))
    assert [path.probability for path in paths] == pytest.approx([1 / 16] * 16)


def test_a_centreline_reaches_as_far_as_asked_straight_beyond_both_ends_of_the_road() -> None:
    points, lanes = centreline(roads.fork(), (1, 12), 10.0, 25.0, 200.0)
    assert points[0] == pytest.approx([-15.0, 0.0])
    assert points[-1] == pytest.approx([210.0, 0.0])
    assert length_of(points) == pytest.approx(225.0)
    assert set(lanes.tolist()) == {1, 12}


def test_lanes_that_follow_each_other_are_joined_once_for_all_places_on_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A ranking asks for some 100 lines of the same few lanes at each moment."""
    road, made = chain_of_forks(2), list[tuple[int, ...]]()

    def counted(known: dict[int, Lane], sequence: tuple[int, ...], start: float) -> object:
        made.append(sequence)
        return joined(known, sequence, start)

    joined = module._joined
    monkeypatch.setattr(module, "_joined", counted)
    for place in (1.0, 2.0, 3.0):
        centreline(road, (1,), place, 0.0, 10.0)
    assert len(made) == 1


def test_where_two_lanes_fit_the_one_counts_that_the_vehicle_came_along() -> None:
    # Lane 2 joins lane 1 from the left at x = 60; a vehicle at x = 55 is nearly as much on either.
    merge = roads.road(
        roads.lane(1, [(0.0, 0.0), (60.0, 0.0)], successors=(3,)),
        roads.lane(2, [(0.0, 15.0), (45.0, 1.0), (60.0, 0.0)], successors=(3,)),
        roads.lane(3, [(60.0, 0.0), (200.0, 0.0)], predecessors=(1, 2)),
    )
    straight = roads.scene_of((55.0, 0.2, -0.02, 15.0))
    (paths,) = candidate_paths(merge, straight)
    assert [path.lanes for path in paths] == [(1, 3)]
    # Without a recorded past both are possible.
    unknown = replace(straight, recorded_steps=np.array([0]))
    (paths,) = candidate_paths(merge, unknown)
    assert sorted(path.lanes for path in paths) == [(1, 3), (2, 3)]


@pytest.mark.parametrize("mapped_m", (300.0, 6.0))
def test_a_lane_change_takes_40_m_from_the_vehicle_on_also_past_the_lane_end_and_the_map(
    mapped_m: float,
) -> None:
    merge = roads.road(
        roads.lane(1, [(0.0, 0.0), (10.0, 0.0)], left=2),
        roads.lane(2, [(0.0, 3.5), (10.0, 3.5)], successors=(3,), right=1),
        roads.lane(3, [(10.0, 3.5), (10.0 + mapped_m, 3.5)]),
    )
    points, owners = centreline(merge, (1, 2, 3), 8.0, 8.0, 80.0)
    y = np.interp([0.0, 8.0, 28.0, 48.0, 80.0], points[:, 0], points[:, 1])
    assert y == pytest.approx([0.0, 0.0, 1.75, 3.5, 3.5], abs=0.02)
    assert np.abs(np.diff(points[:, 1]) / np.diff(points[:, 0])).max() < 0.18  # a third of it in 10 m
    assert owners[0] == 1 and owners[-1] == 3
