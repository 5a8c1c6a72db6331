"""Folders as published: the one recording in them is taken, several are listed, results are left out."""

from __future__ import annotations

import gzip
import json
import os
import shutil
from pathlib import Path

import pytest

import scex_sumo
from scex_sumo.base.errors import MapError, ScexWarning, TrackError
from scex_sumo.converters.datasets.find import find_recordings, left_out, map_and_tracks
from scex_sumo.converters.datasets.interaction import find_tracks
from tests.command import ALONE, scex


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One recording and its map."""
    source = scex_sumo.example_path("roundabout")
    (tmp_path / "data").mkdir()
    for suffix in (".osm", ".csv"):
        shutil.copy(source.with_suffix(suffix), tmp_path / "data" / f"a{suffix}")
    return tmp_path / "data"


def add_result(folder: Path, info: str) -> Path:
    """A result that holds the seed scene as a recording with its map."""
    out = folder / "out"
    out.mkdir()
    add = {"a.osm": "seed.osm", "a.csv": "seed.csv"}
    for name, copy in add.items():
        shutil.copy(folder / name, out / copy)
    (out / info).write_text(json.dumps({"identity": 64 * "0"}))
    return out


def test_pipes_among_recordings_are_not_waited_for(folder: Path) -> None:
    for name in ("run.json", "b.csv"):
        os.mkfifo(folder / name)
    assert [one.name for one in find_recordings([folder])] == ["a"]


def test_map_and_tracks_that_are_swapped_are_called_so(folder: Path) -> None:
    with pytest.raises(MapError, match=r"a\.csv: not a map, but \S+a\.osm is one: they are swapped"):
        scex_sumo.read_seed(folder / "a.csv", tracks=folder / "a.osm")


def test_a_packed_map_is_found_in_a_folder_and_called_swapped_with_its_tracks(folder: Path) -> None:
    packed = folder / "a.osm.gz"
    packed.write_bytes(gzip.compress((folder / "a.osm").read_bytes()))
    (folder / "a.osm").unlink()
    tracks = (folder / "a.csv").rename(folder.parent / "b.csv")
    assert map_and_tracks(folder, tracks) == (packed, tracks)
    with pytest.raises(MapError, match=r"b\.csv: not a map, but \S+a\.osm\.gz is one: they are swapped"):
        map_and_tracks(tracks, packed)
    own = tracks.rename(folder / "vehicle_tracks_000.csv")
    assert map_and_tracks(folder) == (packed, own)


def test_a_map_that_is_plain_and_packed_is_one_map(folder: Path) -> None:
    (folder / "a.osm.gz").write_bytes(gzip.compress((folder / "a.osm").read_bytes()))
    (folder / "a.csv").unlink()
    assert map_and_tracks(folder) == (folder / "a.osm", None)


def test_a_recording_in_the_place_of_its_map_names_the_map(folder: Path) -> None:
    for read in (scex_sumo.read_map, scex_sumo.read_seed, find_tracks):
        with pytest.raises(MapError, match=r"a\.csv: a recording, not a map; its map is \S+a\.osm"):
            read(folder / "a.csv")


def test_a_table_without_a_map_is_not_looked_for_as_its_own_tracks(tmp_path: Path) -> None:
    # As 00_tracks.csv of highD, copied without its 00_recordingMeta.csv.
    tracks = tmp_path / "00_tracks.csv"
    tracks.write_text("frame,id,x,y\n")
    with pytest.raises(MapError, match=r"00_tracks\.csv: a table, not a map; give the map first"):
        find_tracks(tracks)


def test_several_recordings_of_one_map_are_listed(folder: Path) -> None:
    tracks = folder / "recorded_trackfiles" / "a"
    tracks.mkdir(parents=True)
    (folder / "maps").mkdir()
    (folder / "a.osm").rename(folder / "maps" / "a.osm")
    for number in range(2):
        shutil.copy(folder / "a.csv", tracks / f"vehicle_tracks_00{number}.csv")
    (folder / "a.csv").unlink()
    words = r"2 recordings; give one of them with --tracks: recorded_trackfiles/a/vehicle_tracks_000\.csv, "
    with pytest.raises(MapError, match=words):
        map_and_tracks(folder)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sample_annotation.json", "nuScenes as published; convert it by py123d or ScenarioNet"),
        ("segment-1.tfrecord", "Waymo Open Dataset as published"),
        ("2021.db", "nuPlan as published"),
        ("notes.txt", "looked for recorded_trackfiles"),
    ],
)
def test_a_folder_without_a_recording_says_what_to_do(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / name).touch()
    with pytest.raises(MapError, match=words):
        map_and_tracks(tmp_path)
    with pytest.raises(TrackError, match=words):
        find_recordings([tmp_path])


@pytest.mark.parametrize("info", ["run.json", "rank.json", "validate.json", "incomplete.json"])
def test_results_of_this_program_are_left_out_with_a_note(folder: Path, info: str) -> None:
    out = add_result(folder, info)
    note = f"results of this program are left out: {out}"
    with pytest.warns(ScexWarning, match="results of this program"):
        assert [one.name for one in find_recordings(str(folder))] == ["a"]
    assert left_out([folder]) == [note]
    assert map_and_tracks(folder) == (folder / "a.osm", folder / "a.csv")
    with pytest.raises(TrackError, match="is a result of this program; give recordings"):
        find_recordings([out])


def test_commands_take_folders_and_print_what_they_leave_out(folder: Path, tmp_path: Path) -> None:
    add_result(folder, "run.json")
    models = ("--models", "constant_velocity", "--every", "9", "--futures", "2")
    for words in (("inspect", folder), ("rank", folder, *models, "-o", tmp_path / "r")):
        done = scex(*words)
        assert done.returncode == 0, done.stderr
        assert f"note: results of this program are left out: {folder / 'out'}" in done.stderr
    done = scex("run", folder, "--time", "4", "--futures", "2", *ALONE, "-o", tmp_path / "run")
    assert done.returncode == 0, done.stderr
