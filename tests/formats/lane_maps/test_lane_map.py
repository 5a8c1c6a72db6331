"""Roads of lane polylines: bounds, relations and places that a format lacks are found by geometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from tests.formats import streets
from tests.lanelet2sumo.judge.report import check_net


def lanes(*, bounds: bool = True, relations: bool = True, x: float = 0.0, y: float = 0.0) -> list[DrawnLane]:
    drawn = []
    for i in streets.SUCCESSORS:
        one = DrawnLane(name=i, centre=streets.centre(i, x, y), inside=i in streets.INSIDE)
        if bounds:
            one = replace(one, left=streets.bound(i, 1, x, y), right=streets.bound(i, -1, x, y))
        if relations:
            one = replace(
                one,
                successors=streets.SUCCESSORS[i],
                predecessors=streets.PREDECESSORS[i],
                left_neighbours=[streets.LEFT[i]],
                right_neighbours=[streets.RIGHT[i]],
            )
        drawn.append(one)
    return drawn


def road_of(drawn: list[DrawnLane], **parts: object) -> Road:
    return drawn_road(DrawnMap(path=Path("map"), lanes=drawn, **parts), name="street")  # type: ignore[arg-type]


def relations(road: Road) -> dict[int, tuple[object, ...]]:
    return {i: (x.successors, x.predecessors, x.left, x.right, x.conflicts) for i, x in road.lanes.items()}


def test_a_marking_or_an_intersection_forbids_a_lane_change_and_leaves_the_neighbour() -> None:
    drawn = lanes()
    drawn[0] = replace(drawn[0], closed=("left",))
    drawn[2] = replace(drawn[2], inside=True)
    road = road_of(drawn)
    assert [road.lanes[i].left for i in (1, 3)] == [None, None]
    assert [road.lanes[i].adjacent_left for i in (1, 3)] == [2, 4]
    assert road.lanes[4].right is None


def test_far_coordinates_become_local_and_the_road_keeps_the_place() -> None:
    near, far = (
        road_of(lanes()),
        road_of(lanes(x=664_300.0, y=3_998_700.0), lit={1: (664_390.0, 3_998_700.0)}),
    )
    np.testing.assert_allclose(
        far.lanes[3].centreline - near.lanes[3].centreline, [[300.0, 700.0]] * 11, atol=1e-9
    )
    assert far.georeference is None  # its projection is not known
    assert "coordinates are relative to x = 664000 m, y = 3998000 m of the dataset" in far.notes
    (rule,) = far.regulations
    np.testing.assert_allclose(rule.stop_lines[0], [[390.0, 701.75], [390.0, 698.25]], atol=1e-9)
    assert not any("relative" in note for note in near.notes)


def test_heights_keep_a_bridge_apart() -> None:
    level = DrawnLane(
        name=1, centre=[[0, 0, 0], [100, 0, 0]], successors=[], left_neighbours=[], right_neighbours=[]
    )
    over = replace(level, name=2, centre=[[50, -50, 6], [50, 50, 6]])
    assert not road_of([level, over]).lanes[1].conflicts
    assert road_of([level, replace(over, centre=[[50, -50, 1], [50, 50, 1]])]).lanes[1].conflicts == (2,)


def test_stop_signs_lights_and_crosswalks_become_rules_and_areas() -> None:
    outline = [[60, -2], [63, -2], [63, 9], [60, 9]]
    road = road_of(lanes(), stops={1: "stop", 99: "stop"}, lit={2: None}, crosswalks=[outline, [[0, 0]]])
    assert [(rule.kind, rule.lanes) for rule in road.regulations] == [("stop", (1,)), ("traffic_light", (2,))]
    assert [area.kind for area in road.areas] == ["crosswalk"]
    assert len({*road.lanes, *(rule.element_id for rule in road.regulations), road.areas[0].area_id}) == 9


@pytest.mark.parametrize(
    ("bounds", "x", "y"), [(True, 0.0, 0.0), (False, -300.0, 0.0), (True, 664_300.0, 4e6)]
)
def test_its_net_is_faithful(bounds: bool, x: float, y: float, tmp_path: Path) -> None:
    road = road_of(lanes(bounds=bounds, relations=bounds, x=x, y=y))
    report = check_net(convert(road, tmp_path / "street.net.xml").path, road)
    assert not report.problems()
    assert report["deviation_max_m"] <= 0.1 and not report["missing_successors"]
