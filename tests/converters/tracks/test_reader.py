"""Track files become arrays, or one line that says what is wrong with them."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.errors import TrackError
from tests.converters.track_files import CASE_COLUMNS, COLUMNS, in_case, straight, write_rows


def test_vehicles_and_others_are_kept_apart_by_type(tmp_path: Path) -> None:
    rows = straight(1) + straight(2, kind="Truck") + straight(3, kind="Bike") + straight(4, kind="Pedestrian")
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert table.vehicles.labels == ("1", "2")
    assert table.vehicles.types == ("car", "truck")
    assert table.others.labels == ("3", "4")
    assert table.others.types == ("bike", "pedestrian")


def test_the_order_of_rows_and_columns_leaves_no_trace(tmp_path: Path) -> None:
    rows = straight(10) + straight(9, y=4.0) + straight("P1", kind="pedestrian", y=8.0)
    tidy = read_tracks(write_rows(tmp_path / "a.csv", rows))
    random.Random(1).shuffle(rows)
    mixed = read_tracks(write_rows(tmp_path / "b.csv", rows, reversed(COLUMNS)))
    assert tidy.vehicles.labels == mixed.vehicles.labels == ("9", "10")
    for name in ("track", "segment", "frame_id", "timestamp_ms", "x", "y", "vx", "psi_rad", "length"):
        np.testing.assert_array_equal(getattr(tidy.vehicles, name), getattr(mixed.vehicles, name))


def test_unknown_columns_spaces_and_a_byte_order_mark_do_no_harm(tmp_path: Path) -> None:
    rows = [row | {"time": "2022-03-16 11:20:35.498"} for row in straight(7)]
    path = write_rows(tmp_path / "t.csv", rows, ["time", *COLUMNS])
    path.write_text("\ufeff" + path.read_text().replace("psi_rad,", " psi_rad ,", 1))
    assert read_tracks(path).vehicles.labels == ("7",)


def test_pedestrians_of_version_1_0_are_read_from_the_file_beside(tmp_path: Path) -> None:
    path = write_rows(tmp_path / "vehicle_tracks_003.csv", straight(1))
    walk = straight("P1", speed=1.0, kind="pedestrian/bicycle", y=5.0)
    write_rows(tmp_path / "pedestrian_tracks_003.csv", walk, COLUMNS[:8])
    others = read_tracks(path).others
    assert others.labels == ("P1",)
    assert others.psi_rad[0] == 0.0  # along +x, as it walks
    assert (others.length[0], others.width[0]) == (1.8, 0.7)  # may be a cyclist


def test_a_pedestrian_of_a_case_may_lack_heading_and_size(tmp_path: Path) -> None:
    walk = straight(2, kind="pedestrian/bicycle", psi_rad="", length="", width="")
    path = write_rows(tmp_path / "t.csv", in_case("3.0", straight(1) + walk), CASE_COLUMNS)
    table = read_tracks(path)
    assert np.isfinite(table.others.psi_rad).all()
    assert (table.others.length > 0).all()


def test_equal_ids_in_different_cases_are_different_tracks_in_numerical_order(tmp_path: Path) -> None:
    rows = in_case("10.0", straight(1)) + in_case("2.0", straight(1))
    table = read_tracks(write_rows(tmp_path / "t.csv", rows, CASE_COLUMNS))
    assert table.cases == ("2.0", "10.0")
    assert table.vehicles.tracks == 2
    assert len(table.case(1).vehicles) == 41


def test_a_tracker_that_changes_its_mind_is_outvoted(tmp_path: Path) -> None:
    rows = straight(1)
    rows[5]["agent_type"] = "pedestrian"
    assert read_tracks(write_rows(tmp_path / "t.csv", rows)).vehicles.types == ("car",)


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
        ({"x": ""}, ["x of a car is missing"]),
        ({"vy": "nan"}, ["vy of a car is 'nan'"]),
        ({"x": "inf"}, ["x of a car is 'inf'"]),
        ({"psi_rad": ""}, ["psi_rad of a car is missing"]),
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


def test_the_line_counts_blank_lines_too(tmp_path: Path) -> None:
    path = _with(tmp_path, 3, x="nan")
    path.write_text(path.read_text().replace("\n", "\n\n", 1))
    with pytest.raises(TrackError, match="line 6: x of a car"):
        read_tracks(path)


def test_a_missing_file_and_a_folder_are_said_to_be_so(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="no such file"):
        read_tracks(tmp_path / "none.csv")
    with pytest.raises(TrackError, match="a folder; give one CSV file"):
        read_tracks(tmp_path)


def test_a_vehicle_needs_a_number(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="track_id 'A7' of a car is not an integer"):
        read_tracks(write_rows(tmp_path / "t.csv", straight("A7")))


def test_the_real_recordings_are_read_whole(data: Path) -> None:
    path = data / "taf_bw/recorded_trackfiles/k733_2020-09-15/vehicle_tracks_000.csv"
    table = read_tracks(path)
    assert len(table.vehicles) + len(table.others) == 18_625
    assert (table.vehicles.tracks, table.others.tracks) == (58, 16)
    assert table.step_s == pytest.approx(0.1)


def test_the_sample_of_version_1_2_has_three_cases(data: Path) -> None:
    table = read_tracks(data / "interaction/cases/v12_case_format_sample.csv")
    assert table.cases == ("1.0", "2.0", "35.0")
    assert (table.vehicles.tracks, table.others.tracks) == (10, 2)
