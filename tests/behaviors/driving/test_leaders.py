"""Leaders of a driver, and how far ahead they are."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.driving.leaders import Leaders, everyone, find_leaders
from scex_sumo.behaviors.driving.paths import BEHIND_M, seed_paths
from scex_sumo.road import Road
from scex_sumo.scene import Obstacles, VehicleIndex
from tests.behaviors import roads
from tests.seeds import people_of, standing, states_of, steady

OWN = (100.0, 0.0, 0.0, 10.0)  # 4.5 m long, 1.8 m wide, on the lane's centreline
DOWN = -np.pi / 2


def leaders(
    *others: roads.Vehicle,
    own: roads.Vehicle = OWN,
    where: Road | None = None,
    clearance: float = 5.0,
    radius: float = 100.0,
    obstacles: Obstacles | None = None,
) -> Leaders:
    scene = roads.scene_of(own, *others, obstacles=obstacles)
    history = roads.present(scene)
    vehicles = VehicleIndex(future=np.array([0]), vehicle=np.array([0]))
    paths = seed_paths(scene, roads.straight() if where is None else where)
    row = paths.choose(0, vehicles.vehicle, np.zeros(1))
    s, _, _ = paths.foot_points(row, np.array([own[0]]), np.array([own[1]]), np.array([BEHIND_M]))
    return find_leaders(history, vehicles, paths, row, s, clearance=clearance, radius=radius)


def gap(*others: roads.Vehicle, **kwargs: object) -> float:
    return float(leaders(*others, **kwargs).gap[0])  # type: ignore[arg-type]


def test_the_gap_is_bumper_to_bumper() -> None:
    found = leaders((130.0, 0.0, 0.0, 7.0))
    assert (found.gap[0], found.speed[0], found.index[0]) == pytest.approx((25.5, 7.0, 1))


def test_the_clearance_takes_in_the_neighbouring_lane_or_does_not() -> None:
    beside = (130.0, 3.5, 0.0, 7.0)
    assert gap(beside) == pytest.approx(25.5)
    assert gap(beside, clearance=1.5) == np.inf
    assert gap((130.0, 5.2, 0.0, 7.0)) == np.inf


def test_a_vehicle_alongside_is_no_leader_unless_it_is_in_the_way() -> None:
    # Half a length ahead: in the next lane it overlaps along the path but not across.
    assert gap((102.0, 3.5, 0.0, 10.0)) == np.inf
    # One that cuts in: 1.9 m beside, bodies 0.1 m apart.
    assert gap((102.0, 1.9, 0.0, 10.0)) == pytest.approx(2.0 - 4.5)
    # The same one behind is not ours to avoid.
    assert gap((98.0, 1.9, 0.0, 10.0)) == np.inf


def test_distance_is_measured_along_a_curved_path() -> None:
    where = roads.road(roads.lane(1, roads.arc(30.0, 3.0, step=0.5)))
    at = 1.5  # rad around the circle, 45 m
    other = (30 * np.sin(at), 30 - 30 * np.cos(at), at, 5.0)
    found = leaders(other, own=(0.0, 0.0, 0.0, 8.0), where=where)
    # Smoothing shortens the arc by sigma²/(2R²), 0.1 %.
    assert found.gap[0] == pytest.approx(45.0 - 4.5, abs=0.15)
    assert found.speed[0] == pytest.approx(5.0, abs=0.01)


def pedestrian(x: float, y: float, present: bool = True) -> Obstacles:
    still = standing(states_of((x, y, DOWN, 1.4)))
    return people_of(still, length=0.5, width=0.5, present=np.full((1, 11), present))


def test_a_pedestrian_on_the_road_is_a_leader_while_present() -> None:
    found = leaders(obstacles=pedestrian(120.0, 1.0))
    assert (found.gap[0], found.index[0]) == pytest.approx((20.0 - 2.25 - 0.25, 1))
    assert gap(obstacles=pedestrian(120.0, 1.0, present=False)) == np.inf


@pytest.mark.parametrize("ahead", np.linspace(10.0, 60.0, 11).tolist())
def test_in_a_roundabout_the_leader_is_where_it_is_this_lap(ahead: float) -> None:
    radius = 12.0
    half = roads.arc(radius, np.pi, step=0.5), roads.arc(radius, np.pi, (0.0, 2 * radius), np.pi, step=0.5)
    ring = roads.road(
        roads.lane(1, half[0], successors=(2,), predecessors=(2,)),
        roads.lane(2, half[1], successors=(1,), predecessors=(1,)),
    )
    turn = ahead / radius
    other = (radius * np.sin(turn), radius - radius * np.cos(turn), turn, 5.0)
    found = leaders(other, own=(0.0, 0.0, 0.0, 8.0), where=ring)
    # Smoothing draws the ring in by sigma²/(2R) = 0.09 m of 12 m: by less than one part in a hundred.
    assert found.gap[0] == pytest.approx(ahead - 4.5, abs=0.01 * ahead + 0.05)


def test_obstacles_are_further_columns_seen_while_present() -> None:
    present, length = np.array([[True] * 11, [False] * 11]), np.array([0.5, 0.6])
    walkers = people_of(steady(*((12.0, 1.0, 0.0, 0.0),) * 2), length=length, present=present)
    scene = roads.scene_of((10.0, 0.0, 0.0, 8.0), obstacles=walkers)
    all_of_them = everyone(roads.present(scene))
    assert all_of_them.states.x[0, 1] == 12.0 and all_of_them.states.y[0, 1] == 1.0
    assert all_of_them.present.tolist() == [[True, True, False]]
    assert all_of_them.obstacle.tolist() == [False, True, True]
    assert all_of_them.length.tolist() == [4.5, 0.5, 0.6]
