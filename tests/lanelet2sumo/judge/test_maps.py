"""Converted maps reach every figure: the real ones, and maps that are awkward on purpose."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.convert import convert
from scex_sumo.lanelet2sumo.judge.command import convert_command
from scex_sumo.lanelet2sumo.judge.report import FidelityReport, check_net, drive_net
from tests.converters.maps import write_map
from tests.lanelet2sumo.judge.adversarial import MAPS

REAL = (
    "interaction/maps/DR_DEU_Merging_MT.osm",
    "interaction/maps/DR_DEU_Roundabout_OF.osm",
    "taf_bw/maps/k729_2022-03-16.osm",
    "taf_bw/maps/k733_2020-09-15.osm",
)
# What no right of way can prevent: cars that meet head-on in one lane, and cars that appear in the middle of
# a crossing, or where the car ahead has not quite left the short entry that several lanelets share.
HEAD_ON = {"both_ways", "same_ground_both_ways"}
APPEARING = {"border_fork"}
ABOVE_EACH_OTHER = {"bridge"}  # footprints are flat; cars on two levels cover each other


def converted(map_path: Path, folder: Path) -> tuple[Path, FidelityReport]:
    road = read_road(map_path)
    net = convert(road, folder / f"{map_path.stem}.net.xml")
    return net.path, check_net(net.path, road, net.lanes)


def drawn(name: str, folder: Path) -> Path:
    drawing = MAPS[name]()
    path = folder / f"{name}.osm"
    return write_map(path, drawing.lanelets, lines=drawing.lines, relations=drawing.relations)


@pytest.mark.parametrize("name", REAL)
def test_a_real_map_is_converted_faithfully(name: str, data: Path, tmp_path: Path) -> None:
    net, report = converted(data / name, tmp_path)
    assert report.problems() == []
    assert report["lanes_present"] == report["lanelets"] > 0
    assert report["deviation_max_m"] <= 0.10
    assert report["deviation_p95_m"] <= 0.01
    assert report["width_error_mean_m"] <= 0.40
    assert report["probe_hits"] >= 0.99 * report["probes"]
    driving = drive_net(net)
    assert (driving["arrived"], driving["teleports"], driving["overlapping_pairs"]) == (120, 0, 0)


@pytest.mark.parametrize("name", REAL)
def test_a_real_map_gives_the_same_bytes_twice(name: str, data: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        folder.mkdir()
        road = read_road(data / name)
        convert(road, folder / "map.net.xml")
    names = sorted(path.name for path in first.iterdir())
    assert names == sorted(path.name for path in second.iterdir())
    assert all((first / name).read_bytes() == (second / name).read_bytes() for name in names)


@pytest.mark.parametrize("name", REAL)
def test_geometry_alone_finds_what_the_table_says(name: str, data: Path, tmp_path: Path) -> None:
    path, with_table = converted(data / name, tmp_path)
    without = check_net(path, read_road(data / name))
    assert without.problems() == with_table.problems() == []


@pytest.mark.parametrize("name", sorted(MAPS))
def test_an_awkward_map_is_converted_faithfully(name: str, tmp_path: Path) -> None:
    net, report = converted(drawn(name, tmp_path), tmp_path)
    assert report.problems() == []
    if name in HEAD_ON | APPEARING | ABOVE_EACH_OTHER:
        driving = drive_net(net, vehicles=60)
        assert (driving["arrived"], driving["teleports"]) == (driving["vehicles"], 0)
    else:
        assert drive_net(net, vehicles=60).problems() == []


def test_the_command_lets_cars_drive_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = drawn("u_turn", tmp_path)
    net, _ = converted(path, tmp_path)
    said = []
    for drive in (False, True):
        convert_command(path, check=net, drive=drive)
        said.append({line.split()[0]: line.split()[1] for line in capsys.readouterr().out.splitlines()})
    assert "driving_arrived" not in said[0]
    assert said[0].items() <= said[1].items()
    assert (said[1]["driving_arrived"], said[1]["driving_overlapping_pairs"]) == ("120", "0")
