"""Random traffic: ways through a net that cars can drive, and speeds that curves allow."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.generators.demand import LATERAL_MPS2, Network, random_trips, write_curve_limits

# in (two lanes, 100 m) forks: its right lane leads to "right", its left one to "left"; "bike" is no road.
NET = """<net>
  <edge id=":x_0" function="internal"><lane id=":x_0_0" index="0" length="10" speed="10"
                                           shape="95,-9 100,0"/></edge>
  <edge id="in"><lane id="in_0" index="0" length="100" speed="13.9" shape="0,0 100,0" {right_lane}/>
                <lane id="in_1" index="1" length="100" speed="13.9" shape="0,3 100,3" {left_lane}/></edge>
  <edge id="right"><lane id="right_0" index="0" length="50" speed="13.9" shape="100,0 150,0"/></edge>
  <edge id="left"><lane id="left_0" index="0" length="50" speed="13.9" shape="100,3 150,3"/></edge>
  <edge id="bike"><lane id="bike_0" index="0" length="50" speed="5" shape="0,9 50,9" allow="bicycle"/></edge>
  <connection from="in" to="right" fromLane="0" toLane="0"/>
  <connection from="in" to="left" fromLane="1" toLane="0"/>
  <connection from=":x_0" to="right" fromLane="0" toLane="0"/>
  <connection from="bike" to="left" fromLane="0" toLane="0"/>
</net>"""


def network(folder: Path, right_lane: str = "", left_lane: str = "") -> Network:
    path = folder / "net.net.xml"
    path.write_text(NET.format(right_lane=right_lane, left_lane=left_lane))
    return Network(path)


def test_traffic_enters_on_car_lanes_that_nothing_leads_to(tmp_path: Path):
    assert network(tmp_path).origins == [("in", 0), ("in", 1)]


def test_where_lanes_may_be_changed_both_branches_are_reached(tmp_path: Path):
    net, rng = network(tmp_path), np.random.default_rng(0)
    assert {net.random_route(("in", 0), rng) for _ in range(50)} == {("in", "right"), ("in", "left")}


def test_a_net_without_a_way_through_is_refused(tmp_path: Path):
    path = tmp_path / "net.net.xml"
    path.write_text(
        '<net><edge id="a"><lane id="a_0" index="0" length="9" speed="9" shape="0,0 9,0"/></edge></net>'
    )
    with pytest.raises(SimulationError, match="nothing to populate"):
        random_trips(Network(path), until_s=10.0, every_s=(1.0, 1.0), rng=np.random.default_rng(0))


@pytest.mark.parametrize("lanes", [1, 3])
def test_a_single_road_is_driven_from_end_to_end(lanes: int, tmp_path: Path):
    path = tmp_path / "net.net.xml"
    shapes = [
        f'<lane id="a_{k}" index="{k}" length="300" speed="9" shape="0,{k} 300,{k}"/>' for k in range(lanes)
    ]
    path.write_text(f'<net><edge id="a">{"".join(shapes)}</edge></net>')
    trips = random_trips(Network(path), until_s=60.0, every_s=(5.0, 5.0), rng=np.random.default_rng(0))
    assert {trip.edges for trip in trips} == {("a",)}
    assert {trip.lane for trip in trips} == set(range(lanes))


@pytest.mark.parametrize("radius", [12.0, 40.0])
def test_curves_limit_speed_to_comfortable_lateral_acceleration(radius: float, tmp_path: Path):
    angle = np.linspace(0, 1.5, 40)
    shape = " ".join(f"{radius * np.cos(a):.3f},{radius * np.sin(a):.3f}" for a in angle)
    net = tmp_path / "net.net.xml"
    net.write_text(f'<net><edge id="a"><lane id="a_0" index="0" speed="30" shape="{shape}"/></edge></net>')
    write_curve_limits(net, tmp_path / "limited.net.xml")
    lane = next(ElementTree.parse(tmp_path / "limited.net.xml").getroot().iter("lane"))
    assert float(lane.get("speed", 0)) == pytest.approx(np.sqrt(LATERAL_MPS2 * radius), rel=0.01)


def test_a_net_with_many_entries_gets_traffic_on_some_of_them(tmp_path: Path) -> None:
    net, rng = network(tmp_path), np.random.default_rng(1)
    trips = random_trips(net, until_s=400.0, every_s=(40.0, 2.0), rng=rng, most_origins=1)
    assert len(net.origins) > 1 and len({trip.edges[0] for trip in trips}) == 1
