"""Folders of the INTERACTION dataset as published, versions 1.0 and 1.2: found and ranked."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from scex_sumo.converters.datasets.find import find_recordings
from tests.command import scex
from tests.converters.datasets.test_recordings import town
from tests.converters.track_files import CASE_COLUMNS, in_case, straight, write_rows


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """What the archives of the dataset unpack to, with the files that are no recordings."""
    root = tmp_path / "INTERACTION"
    for part, name in (("DR", "DR_USA_Intersection_EP0"), ("TC", "TC_BGR_Intersection_VA")):
        folder = root / f"INTERACTION-Dataset-{part}-v1_0"
        (folder / "maps").mkdir(parents=True)
        town(folder, name)
        (folder / f"maps/{name}.osm_xy").write_text("<osm/>")
        for k in range(2):
            tracks = folder / f"recorded_trackfiles/{name}"
            write_rows(
                tracks / f"vehicle_tracks_{k:03d}.csv",
                straight(1, range(61)) + straight(2, range(61), start=30.0),
            )
            write_rows(
                tracks / f"pedestrian_tracks_{k:03d}.csv",
                straight("P1", range(61), speed=1.0, y=9.0, kind="pedestrian/bicycle"),
            )
        for other in ("copyright.txt", "doc/readme.md", "python/main_visualize_data.py"):
            (folder / other).parent.mkdir(exist_ok=True)
            (folder / other).write_text("text")
    folder = root / "INTERACTION-Dataset-DR-multi-v1_2"
    (folder / "maps").mkdir(parents=True)
    town(folder, "DR_DEU_Roundabout_OF")
    case = in_case("1.0", straight(1, range(1, 41)) + straight(2, range(1, 41), start=30.0))
    for part in ("train", "val"):
        write_rows(folder / f"{part}/DR_DEU_Roundabout_OF_{part}.csv", case, CASE_COLUMNS)
    seen = in_case("1.0", straight(1, range(1, 11)))
    for part in ("test_multi-agent", "test_conditional-multi-agent"):
        write_rows(folder / f"{part}/DR_DEU_Roundabout_OF_obs.csv", seen, CASE_COLUMNS)
    return root


def test_all_recordings_are_found_with_their_maps_and_nothing_else(published: Path) -> None:
    found = find_recordings([published])
    assert [one.name for one in found] == [
        "DR_DEU_Roundabout_OF_train",
        "DR_DEU_Roundabout_OF_val",
        "DR_USA_Intersection_EP0_000",
        "DR_USA_Intersection_EP0_001",
        "TC_BGR_Intersection_VA_000",
        "TC_BGR_Intersection_VA_001",
    ]
    assert {one.dataset for one in found} == {"interaction"}
    assert all(one.map_path.is_file() and one.map_path.suffix == ".osm" for one in found)


def test_one_command_ranks_all_of_it(published: Path, tmp_path: Path) -> None:
    options = ("--futures", 2, "--every", 2, "--workers", 1, "-o", tmp_path / "out")
    done = scex("rank", published, *options)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out/moments.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["recording"] for row in rows} == {one.name for one in find_recordings([published])}
