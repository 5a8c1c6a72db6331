"""Packed files are read wherever unpacked ones are, and found by the same layouts."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import MapError
from scex_sumo.converters.datasets.interaction import find_tracks

DATA = Path(scex.__file__).parent / "scenarios/data"


def pack(source: Path, target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(gzip.compress(source.read_bytes()))
    return target


def beside(folder: Path) -> Path:
    pack(DATA / "roundabout.csv", folder / "roundabout.csv.gz")
    return pack(DATA / "roundabout.osm", folder / "roundabout.osm.gz")


def first_version(folder: Path) -> Path:
    pack(DATA / "roundabout.csv", folder / "recorded_trackfiles/roundabout/vehicle_tracks_000.csv.gz")
    return pack(DATA / "roundabout.osm", folder / "maps/roundabout.osm.gz")


def second_version(folder: Path) -> Path:
    pack(DATA / "roundabout.csv", folder / "train/roundabout_train.csv.gz")
    return pack(DATA / "roundabout.osm", folder / "maps/roundabout.osm.gz")


@pytest.mark.parametrize("layout", [beside, first_version, second_version])
def test_a_packed_dataset_gives_the_same_seed_scene(layout: Callable[[Path], Path], tmp_path: Path) -> None:
    map_path = layout(tmp_path)
    plain = scex.read_seed(DATA / "roundabout.osm")
    packed = scex.read_seed(map_path)
    assert packed.road is not None
    assert packed.road.name == "roundabout"
    np.testing.assert_array_equal(packed.track_ids, plain.track_ids)
    np.testing.assert_array_equal(packed.history.x, plain.history.x)
    for root in (tmp_path, map_path):
        [recording] = scex.find_recordings([root])
        assert recording.map_path == map_path
        assert recording.track_paths == (find_tracks(map_path),)
    assert scex.load_recording(recording).table.vehicles.tracks > 0


def test_a_broken_packed_map_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "roundabout.osm.gz"
    path.write_bytes(gzip.compress((DATA / "roundabout.osm").read_bytes())[:5000])
    with pytest.raises(MapError, match="cannot be unpacked"):
        scex.read_map(path)
