"""Recordings are found by the layouts of datasets, loaded with their map, and cut into seed scenes."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from scex_sumo.base.errors import MapError, ScexError, TrackError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
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


def same(one: SeedScene, other: SeedScene) -> None:
    """Two scenes are the same, to the last bit."""
    for name in ("x", "y", "heading", "speed"):
        assert_array_equal(getattr(one.history, name), getattr(other.history, name))
    assert (one.future is None) == (other.future is None)
    if one.future is not None and other.future is not None:
        assert_array_equal(one.future.x, other.future.x)
        assert_array_equal(one.future.y, other.future.y)
    assert (one.name, one.location, one.time_s, one.types) == (
        other.name,
        other.location,
        other.time_s,
        other.types,
    )
    assert (one.notes, one.source) == (other.notes, other.source)
    assert_array_equal(one.track_ids, other.track_ids)


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


def test_consecutive_chunks_are_one_recording(tmp_path: Path) -> None:
    for first, last in ((1, 79), (80, 159), (160, 239), (320, 399)):
        chunk(tmp_path, first, last, [driving(5, 0.0, 1.0, range(400))], zero=first if first > 1 else 0)
    found = find_recordings([tmp_path])
    assert [(r.name, len(r.track_paths)) for r in found] == [
        ("C-DEU_Site-2_1_T-239", 3),
        ("C-DEU_Site-2_320_T-399", 1),
    ]
    assert {r.site for r in found} == {"C-DEU_Site-2"}
    assert {r.dataset for r in found} == {"commonroad"}


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


def test_chunks_of_different_rates_are_refused(tmp_path: Path) -> None:
    chunk(tmp_path, 1, 79, [driving(5, 0.0, 10.0, range(80))], zero=0)
    second = chunk(tmp_path, 80, 159, [driving(5, 0.0, 10.0, range(80, 160))], zero=80)
    second.write_text(second.read_text().replace('timeStepSize="0.2"', 'timeStepSize="0.1"'))
    with pytest.raises(TrackError, match=r"80_T-159\.xml: its time step is 0\.1 s, that of .* 0\.2 s"):
        load_recording(find_recordings([tmp_path])[0])


@pytest.mark.parametrize("index", [0, 2])
def test_a_seed_scene_is_the_one_that_run_would_read(tmp_path: Path, index: int) -> None:
    recording = find_recordings([interaction(tmp_path)])[index]
    loaded = load_recording(recording)
    for moment in recording_moments(loaded, every_s=1.0):
        scene = seed_at(loaded, moment.time_s, case=moment.case or None)
        assert scene.road is loaded.road
        files = {"tracks": recording.track_paths[0], "case": moment.case or None}
        same(scene, read_seed(recording.map_path, time=moment.time_s, **files))  # type: ignore[arg-type]


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
    assert "gone.osm: no such map" in said["gone_000"]


def test_tracks_that_are_not_on_their_map_are_refused(tmp_path: Path) -> None:
    town(tmp_path)
    tracks = tmp_path / "recorded_trackfiles" / "town" / "vehicle_tracks_000.csv"
    write_rows(tracks, straight(1, range(41), y=700.0))
    with pytest.raises(TrackError, match=r"only 0% of where its vehicles drive is on lanes of .*town\.osm"):
        load_recording(find_recordings([tmp_path])[0])


def test_a_map_whose_origin_is_not_known_is_refused(tmp_path: Path) -> None:
    from tests.converters.lanelet.test_origin import map_at

    map_at(tmp_path / "maps" / "town.osm", (49.0, 8.4))
    write_rows(tmp_path / "recorded_trackfiles" / "town" / "vehicle_tracks_000.csv", straight(1, range(41)))
    with pytest.raises(MapError, match="the origin of its coordinates is not known"):
        load_recording(find_recordings([tmp_path])[0])


def test_results_and_other_tables_in_the_folders_are_no_recordings(tmp_path: Path) -> None:
    interaction(tmp_path)
    write_rows(tmp_path / "out" / "seed.csv", straight(1, range(41)))
    write_rows(tmp_path / ".hidden" / "recorded_trackfiles" / "x" / "vehicle_tracks_000.csv", straight(1))
    write_rows(tmp_path / "recorded_trackfiles" / "town" / "pedestrian_tracks_000.csv", straight("P1"))
    assert len(find_recordings([tmp_path])) == 4
