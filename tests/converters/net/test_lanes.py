"""The table of lanelets and SUMO lanes."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.net.convert import convert
from scex_sumo.converters.net.reading import read_lane_table
from scex_sumo.converters.net.sumo_net import LaneTable
from tests.converters.sumo_roads import lane, road


@pytest.fixture
def table(tmp_path: Path) -> LaneTable:
    """Lane 1 is crossed by lane 9 and leads to lane 2, which may be left for lane 3."""
    drawn = road(
        [
            lane(1, [(0, 0), (80, 0)], to=(2,)),
            lane(2, [(80, 0), (160, 0)], left=3),
            lane(3, [(80, 3.5), (160, 3.5)], right=2),
            lane(9, [(40, -40), (40, 40)]),
        ]
    )
    return convert(drawn, tmp_path / "net.net.xml").lanes


def test_a_crossed_lanelet_is_road_junction_road(table: LaneTable) -> None:
    before, inside, after, joint = table.sumo_lanes(1)
    assert (before, after) == ("l1#0_0", "l1#1_0")
    assert inside.startswith(":")
    assert joint.startswith(":")
    assert table.lanelets(inside) == (1,)
    assert table.lanelets(joint) == (1, 2)  # it takes 5 cm of both


def test_a_written_table_reads_the_same(table: LaneTable, tmp_path: Path) -> None:
    again = read_lane_table(tmp_path / "net.lanes.csv")
    assert (tmp_path / "net.lanes.csv").read_text().splitlines()[0] == "lanelet_id,lane_id"
    for lanelet in (1, 2, 3, 9):
        assert again.sumo_lanes(lanelet) == table.sumo_lanes(lanelet)
    assert again.edges([1, 2]) == table.edges([1, 2])


def test_a_route_that_begins_inside_a_junction_begins_on_the_road_before_it(tmp_path: Path) -> None:
    """Lane 2 lies wholly within its crossing with lane 9, so it is no edge of its own."""
    drawn = road(
        [
            lane(1, [(-40, 0), (-2, 0)], to=(2,)),
            lane(2, [(-2, 0), (2, 0)], to=(3,)),
            lane(3, [(2, 0), (40, 0)]),
            lane(9, [(0, -40), (0, 40)]),
        ]
    )
    net = convert(drawn, str(tmp_path / "net.net.xml"))
    assert all(name.startswith(":") for name in net.lanes.sumo_lanes(2))
    for table in (net.lanes, read_lane_table(tmp_path / "net.lanes.csv")):
        assert table.edges([2]) == table.edges([1, 2, 3])
        assert table.edges([2, 3]) == table.edges([1, 2, 3])
