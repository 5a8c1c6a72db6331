"""A map finds its recording by the layout of the folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.interaction import beside_tracks, find_tracks


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
    with pytest.raises(TrackError, match=r"give --tracks FILE .*, or --synth"):
        find_tracks(net)
    beside = _touch(tmp_path / "a.fcd.xml.gz")
    assert find_tracks(net) == beside
