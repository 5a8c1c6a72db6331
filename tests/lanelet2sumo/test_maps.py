"""Nets of real maps: geometry, lanes, speeds, ways, lane changes, lights."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from tests.converters.sumo_roads import NetFile, load
from tests.lanelet2sumo.judge import report as judge
from tests.lanelet2sumo.judge.driving import drive_net
from tests.lanelet2sumo.judge.loading import check_net

MAPS = (
    "interaction/maps/DR_DEU_Merging_MT.osm",
    "interaction/maps/DR_DEU_Roundabout_OF.osm",
    "taf_bw/maps/k733_2020-09-15.osm",
    "taf_bw/maps/k729_2022-03-16.osm",
)


@pytest.fixture(scope="module", params=MAPS, ids=lambda name: Path(name).stem)
def converted(
    request: pytest.FixtureRequest, data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Road, SumoNet]:
    """A real map and its net."""
    drawn = read_road(data / request.param)
    return drawn, convert(drawn, tmp_path_factory.mktemp("nets") / f"{drawn.name}.net.xml")


def test_the_judge_finds_nothing_with_the_table_or_by_geometry(converted: tuple[Road, SumoNet]) -> None:
    drawn, net = converted
    report = check_net(net.path, drawn, net.lanes)
    assert report.problems() == judge.check_net(net.path, drawn).problems() == []
    assert report["lanes_present"] == report["lanelets"] > 0
    assert report["deviation_max_m"] <= 0.10
    assert report["deviation_p95_m"] <= 0.01
    assert report["width_error_mean_m"] <= 0.40
    assert sum(lost for _, lost in report["lost_probes"]) <= 0.01 * report["probes"]


def test_everyone_arrives_and_nobody_overlaps(converted: tuple[Road, SumoNet]) -> None:
    report = drive_net(converted[1].path)
    assert report["arrived"] == report["vehicles"] == 120
    assert report["teleports"] == report["collisions"] == report["overlapping_pairs"] == 0


def test_the_bytes_are_the_same_every_time(converted: tuple[Road, SumoNet], tmp_path: Path) -> None:
    drawn, net = converted
    again = convert(drawn, tmp_path / net.path.name)
    for suffix in (".net.xml", ".lanes.csv", ".add.xml"):
        name = net.path.name.removesuffix(".net.xml") + suffix
        assert (tmp_path / name).read_bytes() == (net.path.parent / name).read_bytes()
    assert again.lanes.sumo_lanes(min(drawn.vehicle_lanes)) == net.lanes.sumo_lanes(min(drawn.vehicle_lanes))


def test_the_recorded_phases_of_k733_become_its_light(data: Path, tmp_path: Path) -> None:
    drawn = read_road(data / MAPS[2])
    signals = data / "taf_bw" / "recorded_trackfiles" / "k733_2020-09-15" / "signal_phases_000.csv"
    net = convert(drawn, tmp_path / "k733.net.xml", signals=signals)
    assert load(net.path) == ""
    assert net.notes == ()
    file = NetFile(net.path)
    [light] = list(file.root.iter("tlLogic"))
    phases = [(float(p.get("duration", "")), p.get("state", "")) for p in light.iter("phase")]
    # 157.5 s are recorded; three more of yellow lead from the last phase to the first.
    assert sum(seconds for seconds, _ in phases) == pytest.approx(157.5 + 3.0)
    # The southwestern approach 103632 obeys signal group 7: green at 2.8 s to 16.8 s, 92.8 s to 103.8 s.
    [place] = {
        int(c.get("linkIndex", ""))
        for c in file.connections.values()
        if c.get("from") == "l-103632" and c.get("dir") == "s"
    }
    green, now = [], 0.0
    for seconds, state in phases:
        if state[place] in "Gg":
            green.append((now, now + seconds))
        now += seconds
    assert [(round(a, 1), round(b, 1)) for a, b in green] == [(2.8, 16.8), (92.8, 103.8)]
    approaches = {c.get("from") for c in file.connections.values() if c.get("tl")}
    assert len(approaches) == 12
