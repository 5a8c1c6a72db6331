"""Recordings are found by the layouts of datasets, loaded with their map, and cut into seed scenes."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from scex_sumo.base.errors import MapError, ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, seed_at
from tests.converters.maps import straight as lanelet
from tests.converters.maps import write_map
from tests.converters.track_files import CASE_COLUMNS, in_case, straight, write_rows
from tests.formats.commonroad.commonroad_maps import Vehicle, write_scenario
from tests.formats.commonroad.commonroad_maps import straight as road_of

STEP_S = 0.2


def town(folder: Path, name: str = "town") -> Path:
    """A map of one lanelet along +x, 400 m long."""
    path = folder / "maps" / f"{name}.osm"
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_map(path, [lanelet(1, -50.0, 400.0, -1.75)])


def interaction(folder: Path, name: str = "town") -> Path:
    """INTERACTION's folders, both versions: two recordings of v1.0, a train and a val file of cases."""
    town(folder, name)
    for number in (0, 1):
        rows = straight(1, range(61), y=0.0) + straight(2, range(61), start=30.0 + number)
        write_rows(folder / "recorded_trackfiles" / name / f"vehicle_tracks_{number:03}.csv", rows)
    for split, start in (("train", 0.0), ("val", 50.0)):
        rows = [r for c in ("1.0", "2.0") for r in in_case(c, straight(3, range(1, 41), start=start))]
        write_rows(folder / split / f"{name}_{split}.csv", rows, CASE_COLUMNS)
    return folder


def chunk(folder: Path, first: int, last: int, vehicles: list[Vehicle], *, zero: int) -> Path:
    """A chunk whose steps begin at 0 again; the vehicles' states count on."""
    mine = [
        Vehicle(v.vehicle_id, [(k - zero, *rest) for k, *rest in v.states if 0 <= k - zero <= last - first])
        for v in vehicles
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"C-DEU_Site-2_{first}_T-{last}.xml"
    return write_scenario(
        path, [road_of(1, -50, 0, 500)], vehicles=[v for v in mine if v.states], step_s=STEP_S
    )


def driving(number: int, x: float, speed: float, steps: range) -> Vehicle:
    return Vehicle(number, [(k, x + STEP_S * speed * k, 0.0, 0.0, speed) for k in steps])


def test_the_folders_of_interaction_are_found_as_published(tmp_path: Path) -> None:
    found = find_recordings([interaction(tmp_path)])
    assert [r.name for r in found] == ["town_000", "town_001", "town_train", "town_val"]
    assert {r.site for r in found} == {"town"}
    assert {r.dataset for r in found} == {"interaction"}
    assert {r.map_path for r in found} == {tmp_path / "maps" / "town.osm"}


def test_a_map_stands_for_its_recordings_and_a_file_for_itself(tmp_path: Path) -> None:
    interaction(tmp_path)
    assert len(find_recordings([tmp_path / "maps" / "town.osm"])) == 4
    one = tmp_path / "recorded_trackfiles" / "town" / "vehicle_tracks_001.csv"
    assert [r.track_paths for r in find_recordings([one])] == [(one,)]


def test_tracks_in_a_folder_with_one_map_belong_to_it(tmp_path: Path) -> None:
    write_rows(tmp_path / "mine" / "vehicle_tracks_000.csv", straight(1, range(61)))
    town(tmp_path)
    (tmp_path / "maps" / "town.osm").rename(tmp_path / "mine" / "town.osm")
    assert [r.map_path for r in find_recordings([tmp_path / "mine"])] == [tmp_path / "mine" / "town.osm"]
    write_map(tmp_path / "mine" / "village.osm", [lanelet(1, -50.0, 400.0, -1.75)])
    assert [r.map_path.name for r in find_recordings([tmp_path / "mine"])] == ["mine.osm"]  # which one?


def test_a_vehicle_drives_on_across_the_seam_of_two_chunks(tmp_path: Path) -> None:
    vehicles = [driving(5, 0.0, 10.0, range(160)), driving(6, 50.0, 5.0, range(100, 160))]
    late = [
        (100, 151.2, 0.0, 0.0, 5.0),
        *vehicles[1].states[1:],
    ]  # its first state 1.2 m from where it belongs
    vehicles[1] = Vehicle(6, late)
    chunk(tmp_path, 1, 79, vehicles, zero=0)
    chunk(tmp_path, 80, 159, vehicles, zero=80)
    loaded = load_recording(find_recordings([tmp_path])[0])
    rows = loaded.table.vehicles
    assert rows.labels == ("5", "6")
    mine = rows.track == 0
    # 160 steps of 0.2 s, 0 to 31.8 s, at 10 Hz and 10 m/s; the state at the seam is a good one and stays
    assert_array_equal(np.rint(rows.timestamp_ms[mine]), 100.0 * np.arange(319))
    np.testing.assert_allclose(rows.x[mine], 1.0 * np.arange(319), atol=1e-9)
    assert len(np.unique(rows.segment[mine])) == 1
    assert rows.timestamp_ms[rows.track == 1][0] == pytest.approx(20_200.0)
    assert "first states of 1 tracks off their motion: dropped" in loaded.findings
    scene = seed_at(loaded, 16.0)  # the first moment of the second chunk
    assert list(scene.recorded_steps) == [10]
    assert scene.name == "C-DEU_Site-2_1_T-159_t16.0"


def test_a_broken_recording_stops_no_walk_and_is_refused_in_one_line(tmp_path: Path) -> None:
    interaction(tmp_path)
    folder = tmp_path / "recorded_trackfiles" / "town"
    (folder / "vehicle_tracks_002.csv").write_text("track_id,x\n1,2\n")
    (folder / "vehicle_tracks_003.csv").write_bytes(b"")
    write_rows(folder / "vehicle_tracks_004.csv", [r | {"x": "nan"} for r in straight(1, range(20))])
    write_rows(tmp_path / "recorded_trackfiles" / "gone" / "vehicle_tracks_000.csv", straight(1, range(20)))
    (tmp_path / "broken.xml.gz").write_bytes(gzip.compress(b"<commonRoad")[:-4])
    said = {}
    for recording in find_recordings([tmp_path]):
        try:
            load_recording(recording)
        except ScexError as error:
            said[recording.name] = str(error)
    assert sorted(said) == ["broken", "gone_000", "town_002", "town_003", "town_004"]
    assert not any("\n" in line for line in said.values())
    assert "no column" in said["town_002"] and "empty" in said["town_003"] and "nan" in said["town_004"]
    assert "gone.osm: no such file" in said["gone_000"]


def test_a_map_whose_origin_is_not_known_is_refused(tmp_path: Path) -> None:
    from tests.converters.lanelet.test_origin import map_at

    map_at(tmp_path / "maps" / "town.osm", (49.0, 8.4))
    write_rows(tmp_path / "recorded_trackfiles" / "town" / "vehicle_tracks_000.csv", straight(1, range(41)))
    with pytest.raises(MapError, match="the origin of its coordinates is not known"):
        load_recording(find_recordings([tmp_path])[0])
