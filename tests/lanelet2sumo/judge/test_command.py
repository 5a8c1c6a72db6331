"""The command ``convert`` from its arguments to its exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.file import write_map_file
from tests.command import status
from tests.converters.maps import ROAD, straight, write_map
from tests.converters.sumo_roads import NetFile
from tests.lanelet2sumo.mutated.mutations import example, renamed


@pytest.fixture
def lossy(tmp_path: Path) -> Path:
    """The example intersection with a crosswalk of unknown subtype, beside the road."""
    path = tmp_path / "lossy.osm"
    write_map_file(renamed(example("urban_intersection"), [30040], subtype="moving_walkway"), path)
    return path


def test_losses_are_said_last_one_line_for_each_kind(
    lossy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status("convert", lossy, "-o", tmp_path / "n.net.xml") == 0
    lines = capsys.readouterr().out.splitlines()
    lost = "1 of 41 lanelets (2%) not driven, subtype moving_walkway: 30040"
    assert lines[-1] == f"warning: lost: {lost}"


@pytest.mark.parametrize("way", [[], ["--json"]])
def test_losses_are_an_error_where_the_user_is_strict(
    way: list[str], lossy: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert status("convert", lossy, "-o", tmp_path / "n.net.xml", *way, "--strict") == 1
    said = capfd.readouterr()
    assert "--strict, and the map lost 1 lanelets not driven, subtype moving_walkway" in said.err
    if way:
        assert json.loads(said.out)["lost_lanelets"] == [30040]


@pytest.mark.parametrize("way", [[], ["--json"]])
def test_an_unfaithful_net_fails_whatever_is_asked(
    way: list[str], lossy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scex_sumo.lanelet2sumo.judge.report.DEVIATION_MAX_M", -1.0)
    assert status("convert", lossy, "-o", tmp_path / "n.net.xml", *way) == 1


def test_the_limits_of_the_maps_country_hold_where_the_map_gives_none(tmp_path: Path) -> None:
    german = write_map(tmp_path / "de.osm", [straight(1, 0, 50)])
    american = write_map(tmp_path / "us.osm", [straight(1, 0, 50, tags={**ROAD, "region": "us_ca"})])
    speeds = []
    for path in (german, american):
        assert status("convert", path, "-o", tmp_path / "n.net.xml") == 0
        [lane] = NetFile(tmp_path / "n.net.xml").lanes.values()
        speeds.append(float(lane.get("speed", "")))
    assert speeds == pytest.approx([50 / 3.6, 40.2 / 3.6], abs=0.01)  # 25 mph in towns of the US
