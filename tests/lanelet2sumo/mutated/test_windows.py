"""Maps cut by windows, where roads end in the middle and lanelets are missing, become nets that drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.lanelet2sumo.reader import read_net
from tests.converters.sumo_roads import NetFile, lane, road
from tests.lanelet2sumo.judge.driving import border_routes
from tests.lanelet2sumo.judge.report import check_net
from tests.lanelet2sumo.mutated.mutations import EXAMPLES
from tests.lanelet2sumo.mutated.windows import WAYS, judge

# Each once lost a conflict to a stub, put a car in others' way, or came to a standstill.
CUTS = [
    ("roundabout", "dropped", 0),
    ("roundabout", "clipped", 1),
    ("roundabout", "thirds", 3),
    ("urban_intersection", "clipped", 1),
    ("urban_intersection", "clipped", 25),
    ("urban_intersection", "thirds", 27),
]


@pytest.mark.parametrize(("name", "way", "seed"), CUTS)
def test_a_cut_map_is_converted_faithfully_and_driven_without_a_touch(
    name: str, way: str, seed: int, tmp_path: Path
) -> None:
    assert judge(WAYS[way](read_road(EXAMPLES / f"{name}.osm"), seed), tmp_path) == []


def test_roads_that_end_in_each_others_way_are_foes(tmp_path: Path) -> None:
    a_road = road([lane(1, [(-40, 0), (0, 0)]), lane(2, [(-40, 30), (-2, 1.5), (0, 0.8)])])
    net = convert(a_road, tmp_path / "ends.net.xml")
    report = check_net(net.path, a_road, net.lanes)
    assert report["conflicts"] == 1
    assert report.problems() == []


def test_a_lane_that_begins_in_others_way_is_entered_before_its_beginning(tmp_path: Path) -> None:
    a_road = road([lane(1, [(-40, 0), (40, 0)]), lane(2, [(0, 1.0), (1, 5), (1, 40)])])
    net = convert(a_road, tmp_path / "begin.net.xml")
    assert check_net(net.path, a_road, net.lanes).problems() == []
    (entry,) = {
        connection.get("from", "")
        for connection in NetFile(net.path).connections.values()
        if connection.get("to") == "l2"
    }
    shape = read_net(net.path).lanes[f"{entry}_0"].shape
    assert np.hypot(*(shape[0] - (0, 1.0))) == pytest.approx(1.9)
    assert [route[0] for route in border_routes(read_net(net.path))] == ["l1#0"]  # a car on the entry is hit


def test_lanes_of_an_edge_too_short_to_pass_one_another_on_are_not_changed_between(tmp_path: Path) -> None:
    for length, changed in ((8.0, 0), (30.0, 2)):
        rows = [
            lane(10 * k + side, [(x, 3.5 * side), (y, 3.5 * side)], to=to, **beside)
            for k, (x, y) in enumerate(((-30.0, 0.0), (0.0, length), (length, length + 30.0)))
            for side, beside in ((0, {"left": 11} if k == 1 else {}), (1, {"right": 10} if k == 1 else {}))
            for to in [(10 * k + side + 10,) if k < 2 else ()]
        ]
        net = convert(road(rows), tmp_path / "row.net.xml")
        assert len(border_routes(read_net(net.path))) == 2 + changed
