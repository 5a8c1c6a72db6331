from __future__ import annotations

import re
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.net.reading import open_net
from scex_sumo.generators.synthetic import synthetic_seed
from scex_sumo.geometry.polylines import distances, samples
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Regulation, Road
from scex_sumo.scenarios import example_path
from tests.converters import sumo_roads
from tests.converters.plain_net import NET
from tests.runs import extrapolate

NODES = """<nodes>
 <node id="c" x="0" y="0" type="priority"/><node id="e" x="100" y="0"/><node id="w" x="-100" y="0"/>
 <node id="s" x="0" y="-100"/>
</nodes>"""
EDGES = """<edges>
 <edge id="in" from="w" to="c" numLanes="2" speed="13.9" priority="2"/>
 <edge id="out" from="c" to="e" numLanes="2" speed="13.9" priority="2"/>
 <edge id="ramp" from="s" to="c" numLanes="1" speed="8.3" priority="1"/>
</edges>"""


def generate(path: Path, *options: str) -> Path:
    subprocess.run([program("netgenerate"), *options, "-o", str(path)], check=True, capture_output=True)
    return path


@pytest.fixture(scope="module")
def merge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two lanes from the west to the east, joined by a ramp from the south that gives way."""
    folder = tmp_path_factory.mktemp("merge")
    (folder / "n.nod.xml").write_text(NODES)
    (folder / "n.edg.xml").write_text(EDGES)
    command = [program("netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml", "-o", "merge.net.xml"]
    subprocess.run(
        [*command, "--offset.disable-normalization"],
        cwd=folder,
        check=True,
        capture_output=True,
        env=environment(),
    )
    return folder / "merge.net.xml"


def by_name(road: Road) -> dict[str, int]:
    return {lane.subtype: i for i, lane in road.lanes.items()}


def test_lanes_of_an_edge_are_neighbours_and_lead_through_the_junction(merge: Path) -> None:
    road = read_map(merge)
    names = by_name(road)
    right, left = road.lanes[names["in_0"]], road.lanes[names["in_1"]]
    assert (right.left, right.right, left.right) == (left.lane_id, None, right.lane_id)
    assert right.speed_limit_mps == 13.9 and right.width_m == 3.2
    assert road.sumo_lanes  # so that drivers slow down for its curves
    np.testing.assert_allclose(left.centreline[0] - right.centreline[0], [0.0, 3.2], atol=0.01)
    (inside,) = left.successors
    (after,) = road.lanes[inside].successors
    assert road.lanes[inside].subtype.startswith(":") and after == names["out_1"]
    assert road.lanes[after].predecessors == (inside,)


@pytest.mark.parametrize("name", ["motorway_merge", "roundabout", "urban_intersection"])
def test_a_converted_map_read_as_any_net_is_the_same_road(name: str, tmp_path: Path) -> None:
    check(read_map(example_path(name)), tmp_path)


@pytest.mark.parametrize(
    "name",
    [
        "interaction/maps/DR_DEU_Merging_MT.osm",
        "interaction/maps/DR_DEU_Roundabout_OF.osm",
        "taf_bw/maps/k729_2022-03-16.osm",
        "taf_bw/maps/k733_2020-09-15.osm",
    ],
)
def test_real_maps_read_as_any_nets_are_the_same_roads(name: str, data: Path, tmp_path: Path) -> None:
    check(read_map(data / name), tmp_path)


def check(road: Road, folder: Path) -> None:
    """Centrelines within 1 cm; successors and neighbours the same, by the lane table.

    Without what the net says of the lanelets under its lanes: its own lanes are compared.
    """
    net = convert(road, folder / f"{road.name}.net.xml")
    net.path.write_text(re.sub("<param [^>]*>", "", net.path.read_text()))
    back = read_map(net.path)
    own = road.vehicle_lanes
    lines = [lane.centreline for lane in back.lanes.values()]
    for lane in own.values():
        points = samples(lane.centreline, 0.25)[1]
        assert np.min([distances(points, line) for line in lines], axis=0).max() < 0.01
    following, beside_left = set(), set()
    for lane in back.lanes.values():
        here = net.lanes.lanelets(lane.subtype)
        following |= set(pairwise(here))
        for j in lane.successors:
            there = net.lanes.lanelets(back.lanes[j].subtype)
            if here and there and here[-1] != there[0]:
                following.add((here[-1], there[0]))
        if lane.left is not None:
            beside_left |= {(a, b) for a in here for b in net.lanes.lanelets(back.lanes[lane.left].subtype)}
    assert following == {(i, j) for i, lane in own.items() for j in lane.successors if j in own}
    assert beside_left == {(i, lane.left) for i, lane in own.items() if lane.left is not None}


def test_the_net_itself_is_used_and_its_table_names_its_lanes(merge: Path, tmp_path: Path) -> None:
    road = read_map(merge)
    net = convert(road, tmp_path / "copy.net.xml")
    assert net.path.read_bytes() == merge.read_bytes()
    names = by_name(road)
    way = [names["in_1"], *road.lanes[names["in_1"]].successors, names["out_1"]]
    assert open_net(net.path).lanes.edges(way) == ["in", "out"]


@pytest.mark.parametrize("kind", ["merge", "grid", "spider", "lights"])
def test_nets_of_every_shape_are_populated_and_run_on(kind: str, merge: Path, tmp_path: Path) -> None:
    options = {
        "grid": ("--grid", "--grid.number", "3", "--grid.length", "80"),
        "spider": ("--spider", "--spider.arm-number", "4", "--spider.circle-number", "2"),
        "lights": ("--grid", "--grid.number", "2", "--grid.attach-length", "120", "-j", "traffic_light"),
    }
    path = merge if kind == "merge" else generate(tmp_path / f"{kind}.net.xml", *options[kind])
    scene = synthetic_seed(path, vehicles=4)
    run = extrapolate(scene, futures=4, models=["standard_driver", "sumo:EIDM"], out=tmp_path / "out")
    assert run.futures == 4 and run.scene.vehicles == 4
    assert all(np.isfinite(run.states(future).x).all() for future in range(4))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('shape="', 'shape="1e300,0 '),
        ('speed="', 'speed="nan" was="'),
        ('" type="priority"', 'x" type="priority"'),
        ("http://www.w3.org", "%s%n://www.w3.org"),
    ],
)
def test_a_net_that_sumolib_stumbles_over_is_refused(merge: Path, tmp_path: Path, old: str, new: str) -> None:
    path = tmp_path / "n.net.xml"
    path.write_text(merge.read_text().replace(old, new))
    with pytest.raises(MapError, match=r"sumolib cannot read it: .*; build it again with netconvert"):
        read_map(path)


def test_a_net_that_sumo_itself_dies_of_is_refused_before_libsumo_does(tmp_path: Path) -> None:
    net = generate(tmp_path / "g.net.xml", "--grid", "--grid.number", "3")
    lines = net.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if "<connection" in line and "via=" in line)
    net.write_text("\n".join(lines[:first] + lines[first + 1 :]))
    with pytest.raises(MapError, match=r"sumo crashes \(SIG[A-Z]+\) when it loads this net"):
        read_map(net)


@pytest.mark.parametrize("kind", ["right_of_way", "traffic_light"])
def test_a_converted_map_that_begins_in_a_junction_is_read_back(kind: str, tmp_path: Path) -> None:
    rule = Regulation(element_id=9, kind=kind, lanes=(2,), yielding=(2,), priority=(1,), lights=(9,))
    drawn = sumo_roads.road(
        [sumo_roads.lane(1, [(-50, 0), (50, 0)]), sumo_roads.lane(2, [(0, -1), (0, 50)])], [rule]
    )
    back = read_map(convert(drawn, tmp_path / "drawn.net.xml").path)
    assert list(back.lanes) == [1, 2] and not back.notes
    assert kind in {rule.kind for rule in back.regulations if rule.lanes == (2,)}


@pytest.mark.parametrize("left_hand", [False, True])
def test_sides_of_lane_changes_are_the_driver_s(left_hand: bool, tmp_path: Path) -> None:
    content = NET.replace("changeLeft", "changeRight") if left_hand else NET
    path = tmp_path / "n.net.xml"
    path.write_text(content.replace("<net ", '<net lefthand="true" ') if left_hand else content)
    lanes = {lane.subtype: lane for lane in read_map(path).lanes.values()}
    kerb, other = lanes["west_0"], lanes["west_1"]  # from west_1 to west_0, not back
    assert (kerb.left, kerb.right) == (None, None)
    assert (other.left if left_hand else other.right) == kerb.lane_id
    assert (kerb.adjacent_right if left_hand else kerb.adjacent_left) == other.lane_id
