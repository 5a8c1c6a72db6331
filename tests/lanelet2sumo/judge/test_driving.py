"""SUMO's cars drive on a closed circuit, without touching where foes yield, and touch where none is."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from scex_sumo.roads.mirror import mirrored_road
from tests.converters.plain_net import write_net
from tests.converters.sumo_roads import lane, road
from tests.lanelet2sumo.judge.driving import drive_net

HALVES = {"a": "-20,0 0,20 20,0", "b": "20,0 0,-20 -20,0"}


def closed_circuit(folder: Path) -> Path:
    """A ring of two edges that nothing leads into or out of."""
    edges = "".join(
        f'<edge id="{i}" from="{i}0" to="{j}0"><lane id="{i}_0" index="0" speed="9" length="56.5"'
        f' shape="{HALVES[i]}"/></edge>'
        for i, j in (("a", "b"), ("b", "a"))
    )
    junctions = "".join(
        f'<junction id="{i}0" type="priority" x="{x}" y="0" incLanes="{j}_0" intLanes=""'
        f' shape="{x},-2 {x},2">'
        '<request index="0" response="0" foes="0" cont="0"/></junction>'
        for i, j, x in (("a", "b", -20), ("b", "a", 20))
    )
    links = "".join(
        f'<connection from="{i}" to="{j}" fromLane="0" toLane="0" dir="s" state="M"/>'
        for i, j in ("ab", "ba")
    )
    path = folder / "ring.net.xml"
    path.write_text(f'<net version="1.20">{edges}{junctions}{links}</net>', encoding="utf-8")
    return path


def test_cars_drive_on_a_closed_circuit(tmp_path: Path) -> None:
    report = drive_net(closed_circuit(tmp_path), vehicles=6)
    assert (report["arrived"], report["driven_routes"]) == (6, 2)


def test_vehicles_drive_a_faithful_net_without_touching(tmp_path: Path) -> None:
    report = drive_net(write_net(tmp_path), vehicles=40, headway_s=1.0)
    assert report.problems() == []
    assert (report["vehicles"], report["arrived"]) == (40, 40)
    assert report["driven_routes"] == 3  # west to east and north, south to north


def test_vehicles_on_a_net_without_foes_overlap(tmp_path: Path) -> None:
    blind = write_net(
        tmp_path,
        ('<request index="0" response="000" foes="100"', '<request index="0" response="000" foes="000"'),
        ('<request index="1" response="000" foes="100"', '<request index="1" response="000" foes="000"'),
        ('<request index="2" response="011" foes="011"', '<request index="2" response="000" foes="000"'),
    )
    report = drive_net(blind, vehicles=60, headway_s=0.7)
    assert report["overlapping_pairs"] > 0
    assert any("overlap" in line for line in report.problems())


def a_second_lane_opens() -> Road:
    """One lane, then two with lane changes, of which only the left one leads to the left."""
    lanes = [
        lane(1, [(0, 0), (80, 0)], to=(2,)),
        lane(2, [(80, 0), (180, 0)], to=(4,), left=3),
        lane(3, [(80, 3.5), (180, 3.5)], to=(5,), right=2),
        lane(4, [(180, 0), (260, 0)]),
        lane(5, [(180, 3.5), (210, 6), (260, 30)]),
    ]
    return road(lanes)


@pytest.mark.parametrize("drawn", [a_second_lane_opens(), mirrored_road(a_second_lane_opens())])
def test_vehicles_change_lanes_on_both_sides_of_the_world(drawn: Road, tmp_path: Path) -> None:
    report = drive_net(convert(drawn, tmp_path / "opens.net.xml").path, vehicles=60)
    assert report.problems() == []
    assert report["driven_routes"] == 2
