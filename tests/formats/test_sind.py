"""SinD's recordings: a folder each, vehicles and walkers in two files."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.datasets.recordings import read_recorded
from tests.converters.datasets.test_recordings import town
from tests.converters.track_files import COLUMNS, straight, write_rows


def test_recordings_of_sind_are_found_by_their_folders_with_the_only_map_above(tmp_path: Path) -> None:
    town(tmp_path / "city")
    for name in ("8_2_1", "8_3_1"):
        write_rows(tmp_path / "city" / name / "Veh_smoothed_tracks.csv", straight(1, range(61)))
    found = find_recordings([tmp_path])
    assert [r.name for r in found] == ["town_8_2_1", "town_8_3_1"]
    assert {r.dataset for r in found} == {"sind"}
    assert {r.map_path for r in found} == {tmp_path / "city/maps/town.osm"}


def test_sind_has_a_yaw_a_course_and_walkers_beside(tmp_path: Path) -> None:
    rows = [row | {"yaw_rad": 0.1, "heading_rad": 0.2} for row in straight(7, step_ms=1000.0 / 29.97)]
    columns = [*(name for name in COLUMNS if name != "psi_rad"), "yaw_rad", "heading_rad"]
    path = write_rows(tmp_path / "Veh_smoothed_tracks.csv", rows, columns)
    walk = straight("P1", speed=1.0, kind="pedestrian", y=5.0)
    write_rows(tmp_path / "Ped_smoothed_tracks.csv", walk, COLUMNS[:8])
    table, _ = read_recorded([path])
    assert set(table.vehicles.psi_rad.tolist()) == {0.1}
    assert table.others.labels == ("P1",)
