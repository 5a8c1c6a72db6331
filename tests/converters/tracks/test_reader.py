"""Track files become arrays, or one line that says what is wrong with them."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.converters.tracks.reader import read_tracks
from tests.converters.track_files import CASE_COLUMNS, COLUMNS, in_case, straight, write_rows


def test_vehicles_and_others_are_kept_apart_by_type(tmp_path: Path) -> None:
    rows = straight(1) + straight(2, kind="Truck") + straight(3, kind="Bike") + straight(4, kind="Pedestrian")
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert table.vehicles.labels == ("1", "2")
    assert table.vehicles.types == ("car", "truck")
    assert table.others.labels == ("3", "4")
    assert table.others.types == ("bike", "pedestrian")


def test_pedestrians_of_version_1_0_are_read_from_the_file_beside(tmp_path: Path) -> None:
    path = write_rows(tmp_path / "vehicle_tracks_003.csv", straight(1))
    walk = straight("P1", speed=1.0, kind="pedestrian/bicycle", y=5.0)
    write_rows(tmp_path / "pedestrian_tracks_003.csv", walk, COLUMNS[:8])
    others = read_tracks(path).others
    assert others.labels == ("P1",)
    assert others.psi_rad[0] == 0.0  # along +x, as it walks
    assert (others.length[0], others.width[0]) == (1.8, 0.7)  # may be a cyclist


def test_equal_ids_in_different_cases_are_different_tracks_in_numerical_order(tmp_path: Path) -> None:
    rows = in_case("10.0", straight(1)) + in_case("2.0", straight(1))
    table = read_tracks(write_rows(tmp_path / "t.csv", rows, CASE_COLUMNS))
    assert table.cases == ("2.0", "10.0")
    assert table.vehicles.tracks == 2
    assert len(table.case(1).vehicles) == 41


def test_a_gap_of_more_than_half_a_second_parts_a_track(tmp_path: Path) -> None:
    whole = read_tracks(write_rows(tmp_path / "a.csv", straight(1, [0, 1, 2, 7, 8])))
    parted = read_tracks(write_rows(tmp_path / "b.csv", straight(1, [0, 1, 2, 8, 9])))
    assert whole.vehicles.segment.tolist() == [0, 0, 0, 0, 0]
    assert parted.vehicles.segment.tolist() == [0, 0, 0, 1, 1]
    assert parted.vehicles.tracks == 1


def _text(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "t.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def _with(tmp_path: Path, row: int, **values: object) -> Path:
    rows = straight(1)
    rows[row] |= values
    return write_rows(tmp_path / "t.csv", rows)


HEADER = ",".join(COLUMNS)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["empty"]),
        (HEADER + "\n", ["no rows"]),
        ('<?xml version="1.0"?>\n<osm/>\n', ["not CSV", "XML", "map"]),
        (b"\x89PNG\r\n\x1a\n\0\0", ["not CSV"]),
        (HEADER.replace(",", ";") + "\n", ["semicolons", "commas"]),
        (HEADER.replace(",", "\t") + "\n", ["tabs", "commas"]),
        ("a,b,c\n1,2,3\n", ["no column", "track_id", "found: a, b, c"]),
        (HEADER.replace("psi_rad,", "") + "\n", ["no column psi_rad", "need"]),
        (HEADER + ",x\n", ["column x", "twice"]),
        (HEADER + "\n1,2,3\n", ["line 2", "3 values", "11 columns"]),
        (HEADER + "\r" + "1,2,3\r" * 9000, ["lines end with CR alone"]),
        (HEADER.replace(",", ";") + "\n1;2;1,5\n", ["semicolons", "commas"]),
    ],
)
def test_a_file_that_is_no_track_file_is_named_with_what_it_is(
    tmp_path: Path, content: str | bytes, words: list[str]
) -> None:
    path = _text(tmp_path, content)
    with pytest.raises(TrackError) as error:
        read_tracks(path)
    message = str(error.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"x": "abc"}, ["x is 'abc'", "not a number"]),
        ({"x": "inf"}, ["x of a car is 'inf'"]),
        ({"y": "1e300"}, ["y of a car is '1e300'", "beyond 1e+08"]),
        ({"x": "9" * 5000}, ["x of a car is '999", "..."]),
        ({"length": -1}, ["length is -1 m", "positive"]),
        ({"track_id": ""}, ["track_id is missing"]),
        ({"agent_type": ""}, ["agent_type is missing"]),
        ({"timestamp_ms": "late"}, ["timestamp_ms is 'late'"]),
    ],
)
def test_a_bad_value_is_named_with_its_line(
    tmp_path: Path, values: dict[str, object], words: list[str]
) -> None:
    path = _with(tmp_path, 3, **values)  # the fourth row is line 5
    with pytest.raises(TrackError) as error:
        read_tracks(path)
    assert f"{path}: line 5: " in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_an_unknown_type_as_large_as_a_vehicle_that_drives_is_a_vehicle(tmp_path: Path) -> None:
    rows = straight(1, kind="sedan") + straight(2, kind="sedan", speed=0.0, y=4.0) + straight(3, y=8.0)
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert table.vehicles.types == ("vehicle", "vehicle", "car")
    assert table.notes == (
        "unknown type 'sedan': 2 tracks are as large as vehicles and drive: taken for vehicles",
    )


def test_a_packed_file_is_read_as_it_is_unpacked(tmp_path: Path) -> None:
    plain = write_rows(tmp_path / "t.csv", straight(1))
    packed = tmp_path / "t.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    np.testing.assert_array_equal(read_tracks(packed).vehicles.x, read_tracks(plain).vehicles.x)
    packed.write_bytes(packed.read_bytes()[:100])
    with pytest.raises(TrackError, match="cannot be unpacked"):
        read_tracks(packed)


def test_the_real_recordings_are_read_whole(data: Path) -> None:
    path = data / "taf_bw/recorded_trackfiles/k733_2020-09-15/vehicle_tracks_000.csv"
    table = read_tracks(path)
    assert len(table.vehicles) + len(table.others) == 18_625
    assert (table.vehicles.tracks, table.others.tracks) == (58, 16)
    assert table.step_s == pytest.approx(0.1)


def test_a_stamp_of_another_clock_is_refused_with_its_track(tmp_path: Path) -> None:
    rows = straight(1) + [row | {"timestamp_ms": 1.6e12 + 100 * k} for k, row in enumerate(straight(2))]
    path = write_rows(tmp_path / "t.csv", rows)
    with pytest.raises(TrackError, match="hours from track 1 to 2, at most 24 are read; repair the stamps"):
        read_recorded([path])


def test_a_bad_row_behind_one_that_cannot_be_shown_is_named_by_its_number(tmp_path: Path) -> None:
    rows = [{**row, "agent_type": "x" * 200_000} for row in straight(1)[:1]] + straight("", x=9.0)
    with pytest.raises(TrackError, match=r"t\.csv: data row 2 has a missing value; repair or drop the row$"):
        read_tracks(write_rows(tmp_path / "t.csv", rows))
