"""Track files become arrays, or one line that says what is wrong with them."""

from __future__ import annotations

import gzip
import os
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.reader import read_recorded
from scex_sumo.converters.tracks.reader import read_tracks
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


@pytest.mark.parametrize("word", ["", "NA", "null", "nan", "None"])
@pytest.mark.parametrize("column", ["x", "vy", "psi_rad", "length", "timestamp_ms"])
def test_single_rows_without_a_value_are_left_out_and_said(tmp_path: Path, column: str, word: str) -> None:
    table = read_tracks(_with(tmp_path, 3, **{column: word}))
    assert len(table.vehicles) == 40
    assert table.notes == (f"1 rows without {column} left out (first: data row 4)",)


@pytest.mark.parametrize("word", ["", "NA", "null"])
def test_a_column_without_values_is_an_error(tmp_path: Path, word: str) -> None:
    path = write_rows(tmp_path / "t.csv", [row | {"vx": word} for row in straight(1)])
    with pytest.raises(TrackError, match="line 2: vx of a car is "):
        read_tracks(path)


def test_a_missing_frame_number_is_told_by_the_time(tmp_path: Path) -> None:
    table = read_tracks(_with(tmp_path, 3, frame_id="NA"))
    assert table.vehicles.frame_id.tolist() == list(range(41))


def test_stamps_in_seconds_are_told_from_milliseconds(tmp_path: Path) -> None:
    rows = [row | {"timestamp_ms": row["timestamp_ms"] / 1000.0} for row in straight(1)]
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert table.notes == ("timestamp_ms is in seconds: converted to milliseconds",)
    np.testing.assert_allclose(table.vehicles.timestamp_ms, 100.0 * np.arange(41))
    assert table.step_s == pytest.approx(0.1)


@pytest.mark.parametrize("factor", [1e-6, 1e3, 1e6])
def test_stamps_of_other_units_are_an_error(tmp_path: Path, factor: float) -> None:
    rows = [row | {"timestamp_ms": row["timestamp_ms"] * factor} for row in straight(1)]
    with pytest.raises(TrackError, match="give the stamps in milliseconds"):
        read_tracks(write_rows(tmp_path / "t.csv", rows))


@pytest.mark.parametrize("kind", ["lorry", "SUV", "van", "pickup"])
def test_usual_words_for_vehicles_are_known(tmp_path: Path, kind: str) -> None:
    table = read_tracks(write_rows(tmp_path / "t.csv", straight(1, kind=kind)))
    assert table.vehicles.types == (kind.lower(),)
    assert table.notes == ()


def test_an_unknown_type_as_large_as_a_vehicle_that_drives_is_a_vehicle(tmp_path: Path) -> None:
    rows = straight(1, kind="sedan") + straight(2, kind="sedan", speed=0.0, y=4.0) + straight(3, y=8.0)
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert table.vehicles.types == ("vehicle", "vehicle", "car")
    assert table.notes == (
        "unknown type 'sedan': 2 tracks are as large as vehicles and drive: taken for vehicles",
    )


@pytest.mark.parametrize(
    "changes", [{"length": 1.0}, {"width": 0.5}, {"speed": 1.0}, {"kind": "tram"}, {"length": ""}]
)
def test_small_slow_and_known_others_stay_others(tmp_path: Path, changes: dict[str, Any]) -> None:
    table = read_tracks(write_rows(tmp_path / "t.csv", straight(1, **{"kind": "segway", **changes})))
    assert (table.vehicles.tracks, table.others.tracks) == (0, 1)
    assert table.notes == ()


def test_ids_beyond_the_integers_of_floats_stay_apart(tmp_path: Path) -> None:
    ids = [2**53, 2**53 + 1, 2**63 - 1]
    rows = [row for k, own in enumerate(ids) for row in straight(own, y=4.0 * k)]
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert np.unique(table.vehicles.track_id).tolist() == ids
    with pytest.raises(TrackError, match="beyond 64 bits"):
        read_tracks(write_rows(tmp_path / "t.csv", straight(2**63)))


def test_ids_that_are_one_number_are_told_apart(tmp_path: Path) -> None:
    rows = straight("4") + straight("04", y=4.0) + straight("7.0", y=8.0)
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    assert sorted(np.unique(table.vehicles.track_id).tolist()) == [4, 7, 8]
    assert table.notes == ("different track ids that are the same number, renumbered: 04 is 8",)


def test_a_packed_file_is_read_as_it_is_unpacked(tmp_path: Path) -> None:
    plain = write_rows(tmp_path / "t.csv", straight(1))
    packed = tmp_path / "t.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    np.testing.assert_array_equal(read_tracks(packed).vehicles.x, read_tracks(plain).vehicles.x)
    packed.write_bytes(packed.read_bytes()[:100])
    with pytest.raises(TrackError, match="cannot be unpacked"):
        read_tracks(packed)


def test_a_path_that_is_no_utf_8_is_read(tmp_path: Path) -> None:
    odd = tmp_path / os.fsdecode(b"caf\xe9.csv")
    write_rows(odd, straight(1))
    assert read_tracks(odd).vehicles.labels == ("1",)


def test_the_line_counts_blank_lines_too(tmp_path: Path) -> None:
    path = _with(tmp_path, 3, x="inf")
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


def test_the_names_of_columns_may_be_in_any_case(tmp_path: Path) -> None:
    path = write_rows(tmp_path / "t.csv", straight(7))
    text = path.read_text()
    head = text.splitlines()[0]
    path.write_text(text.replace(head, head.upper().replace(",", " , "), 1))
    assert read_tracks(path).vehicles.labels == ("7",)


def test_people_of_no_size_get_the_usual_one_with_a_note(tmp_path: Path) -> None:
    rows = straight(1) + straight(2, y=4.0, agent_type="pedestrian", length=0.0, width=0.6)
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    count = len(straight(2))
    assert table.notes == (f"{count} rows of a length or width that is not positive: the usual one",)
    assert (table.others.length == 0.6).all()


def test_headings_in_degrees_are_told_by_the_driving(tmp_path: Path) -> None:
    rows = straight(1, speed=-10.0, psi_rad=180.0) + straight(2, y=4.0, psi_rad=0.0)
    table = read_tracks(write_rows(tmp_path / "t.csv", rows))
    np.testing.assert_allclose(np.unique(table.vehicles.psi_rad), [0.0, np.pi])
    assert table.notes == ("psi_rad is in degrees: converted to radians",)
    turned = straight(1, psi_rad=4.0 * np.pi) + straight(2, y=4.0)
    assert read_tracks(write_rows(tmp_path / "u.csv", turned)).notes == ()


def test_a_stamp_of_another_clock_is_refused_with_its_track(tmp_path: Path) -> None:
    rows = straight(1) + [row | {"timestamp_ms": 1.6e12 + 100 * k} for k, row in enumerate(straight(2))]
    path = write_rows(tmp_path / "t.csv", rows)
    with pytest.raises(TrackError, match="hours from track 1 to 2, at most 24 are read; repair the stamps"):
        read_recorded([path])
