"""A map finds its recording by the layout of the folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.datasets.interaction import beside_tracks, find_tracks
from scex_sumo.converters.maps import read_map


def _touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def test_the_nearest_layout_wins(tmp_path: Path) -> None:
    the_map = _touch(tmp_path / "maps/A.osm")
    for name in (
        "val/A_val.csv",
        "train/A_train.csv",
        "recorded_trackfiles/A/vehicle_tracks_002.csv",
        "recorded_trackfiles/A/vehicle_tracks_001.csv",
        "maps/A.csv",
    ):
        place = _touch(tmp_path / name)
        assert find_tracks(the_map) == place
        assert beside_tracks(the_map) == (name == "recorded_trackfiles/A/vehicle_tracks_001.csv")


def test_without_tracks_the_error_says_where_it_looked_and_what_to_do(tmp_path: Path) -> None:
    the_map = _touch(tmp_path / "maps/A.osm")
    with pytest.raises(TrackError) as error:
        find_tracks(the_map)
    message = str(error.value)
    for word in (
        str(tmp_path / "maps/A.csv"),
        "recorded_trackfiles/A/vehicle_tracks_*.csv",
        "A_train.csv",
        "A_val.csv",
        "--tracks CSV",
        "--synthetic N",
    ):
        assert word in message
    assert "\n" not in message


def test_a_sumo_net_asks_for_what_sumo_writes(tmp_path: Path) -> None:
    net = _touch(tmp_path / "a.net.xml")
    with pytest.raises(TrackError, match=r"give --fcd FILE .*, --state FILE .* or --tracks CSV, or --synth"):
        find_tracks(net)
    beside = _touch(tmp_path / "a.fcd.xml.gz")
    assert find_tracks(net) == beside


def test_a_folder_is_no_map_and_one_in_it_is_named(tmp_path: Path) -> None:
    for name in ("C-DEU_Site-2_1_T-79.xml", "notes.txt"):
        _touch(tmp_path / "scenarios" / name)
    for read in (find_tracks, read_map):
        with pytest.raises(
            MapError, match=r"scenarios: a folder; give a map in it, e\.g\. C-DEU_Site-2_1_T-79.xml"
        ):
            read(tmp_path / "scenarios")


def test_the_real_maps_find_theirs(data: Path) -> None:
    found = find_tracks(data / "taf_bw/maps/k729_2022-03-16.osm")
    assert found == data / "taf_bw/recorded_trackfiles/k729_2022-03-16/vehicle_tracks_000.csv"
