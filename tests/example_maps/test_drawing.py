"""Maps drawn by hand, read back by Lanelet2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from example_maps.curves import Pose, clothoids
from example_maps.drawing import DASHED, SOLID, MapDrawing, Mark
from scex_sumo.converters.lanelet.projection import to_degrees
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.road import Road

START = Pose(x=1000.0, y=1000.0, heading=0.0)


def read(drawing: MapDrawing, folder: Path) -> Road:
    drawing.write(folder / "drawn.osm")
    return read_road(folder / "drawn.osm")


def two_lanes(middle: Mark, directions: tuple[int, int] = (1, 1)) -> tuple[MapDrawing, list[int]]:
    drawing = MapDrawing()
    curve = clothoids(START, [(50.0, 0.0, 0.01)]).part(0.0, 50.0)
    lanes = drawing.strip(curve, [3.5, 0.0, -3.5], [SOLID, middle, SOLID], directions)
    return drawing, [lane.lanelet_id for lane in lanes]


def test_coordinates_come_back_to_a_micrometre(tmp_path: Path):
    drawing, (left, _) = two_lanes(DASHED)
    lane = read(drawing, tmp_path).lanes[left]
    drawn = clothoids(START, [(50.0, 0.0, 0.01)]).part(0.0, 50.0).offset(3.5)
    # 1e-11 degrees are 1.1e-6 m.
    assert lane.left_bound == pytest.approx(drawn, abs=2e-6)


def test_the_equator_and_the_zero_meridian_are_the_origin():
    [place] = to_degrees(np.array([[0.0, 0.0]]), (0.0, 0.0))
    assert place == pytest.approx((0.0, 0.0), abs=1e-12)


def test_lanes_over_a_dashed_line_are_neighbours_that_may_be_changed_to(tmp_path: Path):
    drawing, (left, right) = two_lanes(DASHED)
    lanes = read(drawing, tmp_path).lanes
    assert (lanes[left].right, lanes[right].left) == (right, left)


def test_lanes_over_a_solid_line_are_neighbours_that_may_not(tmp_path: Path):
    drawing, (left, right) = two_lanes(SOLID)
    lanes = read(drawing, tmp_path).lanes
    assert (lanes[left].adjacent_right, lanes[right].adjacent_left) == (right, left)
    assert (lanes[left].right, lanes[right].left) == (None, None)


def test_lanes_against_the_curve_run_the_other_way(tmp_path: Path):
    drawing, (against, along) = two_lanes(DASHED, (-1, 1))
    lanes = read(drawing, tmp_path).lanes
    assert lanes[along].centreline[0] == pytest.approx([1000.0, 998.25], abs=1e-3)
    assert lanes[against].centreline[-1] == pytest.approx([1000.0, 1001.75], abs=1e-3)
    assert lanes[along].adjacent_left is None  # not in the same direction


def test_a_connecting_lane_succeeds_one_and_precedes_the_other(tmp_path: Path):
    drawing = MapDrawing()
    first = drawing.strip(
        clothoids(START, [(20.0, 0.0, 0.0)]).part(0.0, 20.0), [1.75, -1.75], [SOLID, SOLID], [1]
    )[0]
    second = drawing.strip(
        clothoids(Pose(x=1040.0, y=1020.0, heading=np.pi / 2), [(20.0, 0.0, 0.0)]).part(0.0, 20.0),
        [2.0, -2.0],
        [SOLID, SOLID],
        [1],
    )[0]
    between = drawing.connect(first, second)
    drawing.speed_limit([between], 30)
    drawing.right_of_way([between], [second], None)
    road = read(drawing, tmp_path)
    assert road.lanes[first.lanelet_id].successors == (between.lanelet_id,)
    assert road.lanes[between.lanelet_id].successors == (second.lanelet_id,)
    assert road.lanes[between.lanelet_id].speed_limit_mps == pytest.approx(30 / 3.6)
    (rule,) = road.regulations
    assert (rule.yielding, rule.priority) == ((between.lanelet_id,), (second.lanelet_id,))


def test_the_same_drawing_gives_the_same_bytes(tmp_path: Path):
    for name in ("a.osm", "b.osm"):
        two_lanes(DASHED)[0].write(tmp_path / name)
    assert (tmp_path / "a.osm").read_bytes() == (tmp_path / "b.osm").read_bytes()
