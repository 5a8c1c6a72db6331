"""What SUMO's programs say about a net, and where SUMO puts cars on it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from scex_sumo.lanelet2sumo.convert import convert
from tests.converters.plain_net import Table, crossing, write_net
from tests.converters.sumo_roads import lane, road
from tests.lanelet2sumo.judge.loading import check_net

LOOP = (
    '<edge id="spare" from="J" to="J">'
    '<lane id="spare_0" index="0" speed="9" length="30" shape="20,-40 50,-40"/></edge><edge id="south"'
)


def test_a_net_that_netconvert_refuses_is_found(tmp_path: Path) -> None:
    # An edge from a junction to itself is a lane for sumo and a mistake for netconvert.
    report = check_net(write_net(tmp_path, ('<edge id="south"', LOOP)), crossing(), Table())
    assert any("spare" in line for line in report["netconvert_errors"])
    assert report["sumo_warnings"] == ()


def test_what_sumo_says_is_reported(tmp_path: Path) -> None:
    net = write_net(tmp_path, ('intLanes=":J_0_0 :J_1_0 :J_2_0"', 'intLanes=":J_0_0 :J_1_0 :J_9_0"'))
    report = check_net(net, crossing(), Table())
    assert any(":J_9_0" in line for line in report["sumo_warnings"])
    assert any("sumo says" in line for line in report.problems())


def test_a_lane_that_sumo_cannot_find_again_is_found(tmp_path: Path) -> None:
    class Swapped(Table):
        lanes: ClassVar[dict[int, str]] = {**Table.lanes, 3: "north_0", 6: "east_0"}

    report = check_net(write_net(tmp_path), crossing(), Swapped())
    assert {lanelet for lanelet, _ in report["lost_probes"]} == {3, 6}
    assert any("moveToXY" in line for line in report.problems())


def test_where_lanelets_lie_on_each_other_either_lane_is_right_for_a_car(tmp_path: Path) -> None:
    """SUMO takes any of the lanes that cover a place, here 1 for all probes on 2."""
    overlapping = road([lane(1, [(0, 0), (100, 0)]), lane(2, [(0, 0.8), (100, 0.8)])])
    net = convert(overlapping, tmp_path / "net.net.xml")
    assert check_net(net.path, overlapping, net.lanes)["lost_probes"] == ()
    apart = road([lane(1, [(0, 0), (100, 0)]), lane(2, [(0, 2.5), (100, 2.5)])])
    net = convert(apart, tmp_path / "net.net.xml")
    drawn = "0.000000000,0.000000000 100.000000000,0.000000000"
    text = net.path.read_text()
    assert drawn in text
    net.path.write_text(text.replace(drawn, drawn.replace(",0.000000000", ",1.600000000")))
    assert check_net(net.path, apart, net.lanes)["lost_probes"] == ((2, 51),)  # only the net has 1 there
