"""The example maps, read as users read them: every relation as it was drawn."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from scex_sumo.converters.lanelet import read_road
from scex_sumo.errors import UsageError
from scex_sumo.road import Lane, Road
from scex_sumo.scenarios import EXAMPLES, example_path, example_seeds
from scex_sumo.scenarios.make_examples import draw


@cache
def road(name: str) -> Road:
    return read_road(example_path(name))


def reachable(lanes: dict[int, Lane], start: int) -> set[int]:
    """Lanes that can be reached by driving on and by permitted lane changes."""
    found, queue = {start}, [start]
    while queue:
        lane = lanes[queue.pop()]
        for onward in (*lane.successors, lane.left, lane.right):
            if onward is not None and onward not in found:
                found.add(onward)
                queue.append(onward)
    return found


def test_there_are_three_examples_and_each_has_its_tracks_beside_it():
    assert set(example_seeds()) == {"roundabout", "motorway_merge", "urban_intersection"}
    for path in example_seeds().values():
        assert path.exists()
        assert path.with_suffix(".csv").stat().st_size < 300_000


def test_an_unknown_example_is_refused_with_the_choices():
    with pytest.raises(UsageError, match=r"'ring'; known: roundabout, motorway_merge"):
        example_path("ring")


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_script_draws_the_shipped_map_byte_for_byte(name: str, tmp_path: Path):
    draw(name).write(tmp_path / "map.osm")
    assert (tmp_path / "map.osm").read_bytes() == example_path(name).read_bytes()


@pytest.mark.parametrize("name", EXAMPLES)
def test_maps_are_read_without_repairs(name: str):
    assert road(name).notes == ()


@pytest.mark.parametrize("name", EXAMPLES)
def test_maps_lie_around_1000_1000_as_interaction_maps_do(name: str):
    points = np.vstack([lane.centreline for lane in road(name).lanes.values()])
    assert np.all(np.abs(points.mean(0) - 1000) < 150)


@pytest.mark.parametrize("name", EXAMPLES)
def test_from_every_way_in_every_kind_of_lane_leads_out(name: str):
    lanes = road(name).vehicle_lanes
    exits = {i for i, lane in lanes.items() if not lane.successors}
    for start in lanes:
        assert reachable(lanes, start) & exits


@pytest.mark.parametrize("name", EXAMPLES)
def test_bounds_are_smooth(name: str):
    # Drawn within 2 cm of the smallest radius of about 8 m: no step may turn by more than 2 asin(1.3 / 16).
    for lane in road(name).vehicle_lanes.values():
        for bound in (lane.left_bound, lane.right_bound):
            step = np.diff(bound, axis=0)
            heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
            assert np.degrees(np.abs(np.diff(heading)).max(initial=0)) < 13


@pytest.mark.parametrize("name", EXAMPLES)
def test_successors_go_on_in_the_same_direction(name: str):
    lanes = road(name).vehicle_lanes
    for lane in lanes.values():
        for onward in lane.successors:
            before = np.diff(lane.right_bound[-2:], axis=0)[0]
            after = np.diff(lanes[onward].right_bound[:2], axis=0)[0]
            turn = np.angle(complex(*after) / complex(*before))
            assert abs(np.degrees(turn)) < 7  # half a step on either side


@pytest.mark.parametrize("name", EXAMPLES)
def test_lanes_are_as_wide_as_at_their_ends(name: str):
    # Most have one width; those into the roundabout widen. 8 cm: a shared bound cannot fit both its lanes.
    for lane in road(name).vehicle_lanes.values():
        left, right = LineString(lane.left_bound), LineString(lane.right_bound)
        widths = [left.distance(Point(p)) + right.distance(Point(p)) for p in lane.centreline[1:-1]]
        ends = np.linalg.norm(lane.left_bound[[0, -1]] - lane.right_bound[[0, -1]], axis=1)
        assert ends.min() - 0.08 < min(widths) <= max(widths) < ends.max() + 0.08
        assert 3.2 < ends.min() <= ends.max() < 4.6
