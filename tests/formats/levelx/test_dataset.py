"""Recordings of inD, rounD, exiD and highD, written by hand in their published formats."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from lanelet2.core import BasicPoint3d
from lanelet2.io import Origin
from lanelet2.projection import UtmProjector
from numpy.testing import assert_allclose

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.maps import read_map
from scex_sumo.evaluation.recordings import load_recording, seed_at
from scex_sumo.formats.levelx import read_levelx
from scex_sumo.roads.matching import match
from scex_sumo.scenarios.seeds import read_seed
from tests.converters.lanelet.test_origin import map_at
from tests.formats.levelx.levelx_files import IND_META, Mover, write_highd, write_ind

PLACE = (49.0, 8.4)  # zone 32, north
EASTING_M, NORTHING_M = 456_000.0, 5_427_000.0  # 118 m west and 455 m south of the place


def place_of(east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of a point relative to the recording's origin, by Lanelet2's own projection."""
    projector = UtmProjector(Origin(*PLACE), False, False)
    point = projector.reverse(BasicPoint3d(EASTING_M + east_m, NORTHING_M + north_m, 0.0))
    return point.lat, point.lon


def intersection(folder: Path, movers: list[Mover]) -> Path:
    """inD's folders: ``data`` with one recording and ``maps``, with a lanelet from (100, 400) eastwards."""
    meta = IND_META | {"xUtmOrigin": EASTING_M, "yUtmOrigin": NORTHING_M}
    tracks = write_ind(folder / "data", movers, meta=meta)
    map_at(folder / "maps" / "lanelets" / "04" / "location4.osm", place_of(100.0, 400.0))
    map_at(folder / "maps" / "lanelets" / "01" / "location1.osm", place_of(5000.0, 400.0))
    return tracks


def test_ind_gives_centres_headings_and_sizes_as_recorded(tmp_path: Path) -> None:
    northwest = Mover(number=7, x=10.0, y=-20.0, heading=3 * math.pi / 4, speed=10.0, first=50)
    table = read_levelx(write_ind(tmp_path, [northwest]))
    rows = table.vehicles
    assert (rows.labels, rows.types, table.step_s) == (("7",), ("car",), 0.04)
    assert_allclose(rows.timestamp_ms, 40.0 * np.arange(50, 151))
    # one second on, 10 m to the north-west
    assert_allclose((rows.x[25], rows.y[25]), (10.0 - 50**0.5, -20.0 + 50**0.5), atol=1e-4)
    assert_allclose(rows.psi_rad, 3 * math.pi / 4, atol=1e-6)
    assert_allclose((rows.vx, rows.vy), np.array([[-(50**0.5)], [50**0.5]]).repeat(101, 1), atol=1e-4)
    assert (rows.length[0], rows.width[0]) == (4.5, 1.8)


def test_highd_turns_y_upwards_and_boxes_into_centres(tmp_path: Path) -> None:
    right = Mover(number=1, x=30.0, y=-23.0, speed=30.0, length=5.0)
    left = Mover(
        number=2, x=300.0, y=-10.5, heading=math.pi, speed=25.0, kind="truck", length=12.0, width=2.5
    )
    path = write_highd(tmp_path, [right, left])
    first = path.read_text().splitlines()[1].split(",")
    assert first[2:6] == ["27.5", "22.1", "5.0", "1.8"]  # upper left corner and sides of the first box
    rows = read_levelx(path).vehicles
    assert rows.types == ("car", "truck")
    assert_allclose((rows.x[0], rows.y[0]), (30.0, -23.0))
    assert_allclose((rows.x[-1], rows.y[-1]), (300.0 - 25.0 * 4.0, -10.5))
    assert_allclose(rows.psi_rad[[0, -1]], (0.0, math.pi))
    assert (rows.length[-1], rows.width[-1]) == (12.0, 2.5)


def test_ind_is_found_with_the_map_at_its_place_and_lies_on_it(tmp_path: Path) -> None:
    movers = [Mover(number=k, x=105.0 + 12 * k, y=402.0, speed=8.0, heading=0.013) for k in (1, 2)]
    intersection(tmp_path, movers)
    (recording,) = find_recordings([tmp_path])
    assert (recording.name, recording.site, recording.dataset) == ("location4_00", "location4", "levelx")
    loaded = load_recording(recording)
    assert loaded.table.step_s == 0.1
    scene = seed_at(loaded, 2.0)
    assert "recorded at 25 Hz: interpolated to 10 Hz" in scene.notes
    assert scene.road is loaded.road
    now = scene.now
    assert_allclose(now.x, [133.0 - 0.0013, 145.0 - 0.0013], atol=2e-3)
    assert set(match(loaded.road, now.x, now.y, now.heading).vehicle) == {0, 1}
    again = read_seed(recording.map_path, tracks=recording.track_paths[0], time=2.0)
    assert again.name == scene.name == "location4_00_t2.0"
    assert_allclose(again.history.x, scene.history.x, rtol=0.0, atol=0.0)


def test_highd_needs_no_map(tmp_path: Path) -> None:
    movers = [Mover(number=1, x=30.0, y=-23.0, speed=30.0), Mover(number=2, x=60.0, y=-31.0, speed=30.0)]
    movers.append(Mover(number=3, x=300.0, y=-10.5, heading=math.pi, speed=28.0))
    write_highd(tmp_path, movers)
    (recording,) = find_recordings([tmp_path])
    assert recording.name == "highd_01"
    loaded = load_recording(recording)
    now = seed_at(loaded, 2.0).now
    matched = match(loaded.road, now.x, now.y, now.heading)
    # highD's own numbers: 2 and 3 above, 5, 6 and 7 below; 23 lies between 21 and 25, 31 between 29 and 33
    assert dict(zip(matched.vehicle, matched.lane_id, strict=True)) == {0: 5, 1: 7, 2: 2}
    assert read_seed(recording.map_path, time=2.0).name == "highd_01_t2.0"


def test_highds_lanes_lead_the_right_way_and_may_be_changed(tmp_path: Path) -> None:
    write_highd(tmp_path, [Mover(number=1, x=0.0, y=-23.0)])
    road = read_map(tmp_path / "01_recordingMeta.csv")
    assert sorted(road.lanes) == [2, 3, 5, 6, 7]
    upper, lower = road.lanes[2], road.lanes[5]
    assert (
        upper.centreline[0, 0] > upper.centreline[-1, 0] and lower.centreline[0, 0] < lower.centreline[-1, 0]
    )
    assert_allclose(upper.centreline[:, 1], -(8.51 + 12.59) / 2.0)
    # who drives to the left has the top of the picture on the right
    assert upper.right_bound[0, 1] == -8.51 and upper.left_bound[0, 1] == -12.59
    assert (upper.left, upper.right) == (3, None)
    assert (lower.left, lower.right, road.lanes[6].left, road.lanes[6].right) == (None, 6, 5, 7)
    assert upper.speed_limit_mps == pytest.approx(130 / 3.6)
    assert "no speed limit" in road.notes[0]
    assert [mark.kind for mark in road.markings].count("road_border") == 4  # two of each carriageway


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("00_tracks.csv", "xCenter", "centre", "no xCenter in it"),
        ("00_tracks.csv", "1.0", "", "of line 2 is missing"),
        ("00_tracks.csv", "1.0", "abc", "no table can be read: .*abc"),
        ("00_tracks.csv", "1.0", "1e300", r"of line 2 is 1e\+300, beyond 1e\+08"),
        ("00_tracksMeta.csv", "class", "kind", "no column class"),
        ("00_tracksMeta.csv", "1,car", "5,car", "no row for track 1"),
        ("00_recordingMeta.csv", "25", "-1", "frameRate is '-1'; frames per second expected"),
    ],
)
def test_broken_files_are_refused_in_one_line(
    tmp_path: Path, file: str, old: str, new: str, said: str
) -> None:
    tracks = write_ind(tmp_path, [Mover(number=1, x=1.0, y=2.0)])
    path = tmp_path / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(TrackError, match=said) as refused:
        read_levelx(tracks)
    assert "\n" not in str(refused.value)
    assert str(tmp_path) in str(refused.value)


def test_a_file_that_is_not_there_is_said_to_belong_to_the_tracks(tmp_path: Path) -> None:
    tracks = write_ind(tmp_path, [Mover(number=1, x=1.0, y=2.0)])
    (tmp_path / "00_tracksMeta.csv").unlink()
    with pytest.raises(TrackError, match=r"00_tracksMeta.csv: no such file; it belongs to the tracks beside"):
        read_levelx(tracks)


def test_a_recording_that_is_on_none_of_the_maps_is_found_and_then_refused(tmp_path: Path) -> None:
    intersection(tmp_path, [Mover(number=1, x=100.0, y=-900.0)])
    (recording,) = find_recordings([tmp_path])
    with pytest.raises(TrackError, match=r"only 0% of where its vehicles drive is on lanes of .*location4"):
        load_recording(recording)
