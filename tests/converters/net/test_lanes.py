"""The table of lanelets and SUMO lanes."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.net.reading import read_lane_table
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.lanelet2sumo.convert import convert
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
