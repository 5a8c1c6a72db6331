"""What a repair of a recording costs is said; a recording that loses most of its vehicles is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.converters.maps import read_map
from scex_sumo.scene import SeedScene
from tests.converters.maps import straight, write_map
from tests.converters.track_files import straight as tracks_along
from tests.converters.track_files import write_rows


def driven(tmp_path: Path, change: Callable[[list[str]], list[str]], lead: str = "") -> SeedScene:
    """The moment at 1.1 s of four vehicles on a road, with changed lines of tracks."""
    road = read_map(write_map(tmp_path / "road.osm", [straight(1, -50, 300)]))
    rows = [row for k in range(1, 5) for row in tracks_along(k, range(61), start=30.0 * k)]
    tracks = write_rows(tmp_path / "tracks.csv", rows)
    header, *lines = tracks.read_text().splitlines()
    tracks.write_text(lead + "\n".join([header, *change(lines), ""]))
    return recorded_scene(tmp_path / "road.osm", tracks=tracks, road=road, time_s=1.1)


def of_track(line: str, *tracks: str) -> bool:
    return line.partition(",")[0] in tracks


def test_what_a_repair_costs_is_said_first(tmp_path: Path) -> None:
    twice = driven(tmp_path, lambda lines: [line for line in lines for _ in range(2)])
    assert twice.vehicles == 4
    assert twice.notes[0].startswith("tracks.csv repaired: 244 of 488 rows left out; 244 duplicate samples")
    assert not any("overlap" in note for note in twice.notes)


def at_once(lines: list[str], *tracks: str) -> list[str]:
    """The lines with one time stamp for all samples of some tracks."""
    return [
        re.sub(r"^(\d+,\d+),\d+,", r"\1,1100,", line) if of_track(line, *tracks) else line for line in lines
    ]


def test_repairs_that_lose_over_a_tenth_of_the_vehicles_are_a_warning(tmp_path: Path) -> None:
    scene = driven(tmp_path, lambda lines: at_once(lines, "1"))
    assert scene.notes[0].startswith("tracks.csv repaired: 1 of 4 vehicles and 61 of 244 rows left out; ")
    assert "warning: repairs leave out 1 of 4 vehicles: mend the tracks" in scene.notes


def test_repairs_that_lose_over_half_of_the_vehicles_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match=r"repairs leave out 3 of 4 vehicles: mend the tracks; read_seed"):
        driven(tmp_path, lambda lines: at_once(lines, "1", "2", "3"))


def test_blank_lines_before_the_header_do_not_matter(tmp_path: Path) -> None:
    assert driven(tmp_path, lambda lines: lines, lead="\ufeff\n \r\n").vehicles == 4
    with pytest.raises(TrackError, match=r"line 5: x is 'far', not a number"):
        driven(tmp_path, lambda lines: [lines[0], re.sub(r",car,[^,]*,", ",car,far,", lines[1])], lead="\n\n")
