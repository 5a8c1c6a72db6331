"""A map format of another package is one file: run and inspected by the name of its maps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scex_sumo import example_path
from tests.command import ALONE
from tests.converters.track_files import straight, write_rows
from tests.extensions.package import install, scex

CODE = '''
import numpy as np
from scex_sumo import Lane, Road


def is_mine(path):
    return path.suffix == ".xyz"


def read(path, **options):
    """A line for each lane: its number, where it begins and ends along x, and the lane that follows."""
    lanes = {}
    for line in path.read_text().splitlines():
        number, start, end, *after = map(int, line.split())
        x = np.linspace(start, end, 20)
        left, centre, right = (np.stack([x, np.full(20, y)], axis=1) for y in (1.75, 0.0, -1.75))
        lanes[number] = Lane(
            lane_id=number, centreline=centre, left_bound=left, right_bound=right, width_m=3.5,
            speed_limit_mps=14.0, subtype="road", location="urban", successors=tuple(after),
            predecessors=(number - 1,) if number > 1 else (),
        )
    return Road(name=path.stem, lanes=lanes)
'''


def a_map(folder: Path) -> Path:
    path = folder / "mymap.xyz"
    path.write_text("1 0 200 2\n2 200 400\n")
    return path


def test_a_map_of_another_packages_format_is_populated_and_run(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger", code=CODE)
    options = ("--synthetic", 2, "--futures", 2, "--models", "constant_velocity", *ALONE)
    done = scex(tmp_path, "run", a_map(tmp_path), *options, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out/run.json").read_text())["seed_scene"]["location"] == "mymap"


def test_a_map_format_that_draws_at_random_is_told_by_convert(tmp_path: Path) -> None:
    code = CODE.replace("np.full(20, y)", "np.random.normal(y, 1e-3, 20)")
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger", code=code)
    done = scex(tmp_path, "convert", a_map(tmp_path), "-o", tmp_path / "net.net.xml")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "map format xyz: read returned something else when called again" in done.stderr


def test_a_map_format_that_cannot_be_used_is_left_out_with_a_warning(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger", code="def is_mine(path): ...")
    done = scex(tmp_path, "inspect", a_map(tmp_path))
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "warning: map format xyz is left out" in done.stderr and "has no function read" in done.stderr


@pytest.mark.parametrize(
    ("line", "instead", "says"),
    [
        ("lanes = {}", "lanes = {}['line']", "read raised KeyError: 'line' (stranger.py, line 12)"),
        ("return Road(name=path.stem, lanes=lanes)", "return lanes", "read returned dict, needs Road"),
        (
            'return path.suffix == ".xyz"',
            'raise OSError("x")',
            "is_mine raised OSError: x (stranger.py, line 7)",
        ),
    ],
)
def test_an_error_of_a_map_format_is_one_line_with_its_line(
    line: str, instead: str, says: str, tmp_path: Path
) -> None:
    code = CODE.replace(line, instead)
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger", code=code)
    done = scex(tmp_path, "convert", a_map(tmp_path), "-o", tmp_path / "n.net.xml")
    assert (done.returncode, done.stderr) == (1, f"error: map format xyz: {says}\n")


@pytest.mark.parametrize(
    ("part", "instead", "says"),
    [
        (
            "successors=tuple(after)",
            "successors=(7,)",
            "lane 1: successors names 7, which is no lane of the map",
        ),
        ("speed_limit_mps=14.0", "speed_limit_mps=0.0", "lane 1: speed_limit_mps is 0.0; needs more than 0"),
        ("width_m=3.5", "width_m=float('nan')", "lane 1: width_m is nan; needs more than 0"),
        ("lane_id=number", "lane_id=number + 1", "lane 1: its lane_id is 2; give it its key in lanes"),
        (
            "left_bound=left",
            "left_bound=left[:1]",
            "lane 1: left_bound is no line of 2 or more finite points",
        ),
    ],
)
def test_a_road_that_cannot_be_is_named(part: str, instead: str, says: str, tmp_path: Path) -> None:
    code = CODE.replace(part, instead)
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger", code=code)
    done = scex(tmp_path, "convert", a_map(tmp_path), "-o", tmp_path / "n.net.xml")
    assert done.returncode == 1 and done.stderr.startswith(f"error: {a_map(tmp_path)}: {says}")


def test_a_declared_map_format_is_imported_for_its_own_maps_alone(tmp_path: Path) -> None:
    code = """
from scex_sumo.converters.registries import Declaration

def _reader():
    import xyz_reader

    return xyz_reader

DECLARED = Declaration(lambda path: path.suffix == ".xyz", _reader)
"""
    (tmp_path / "xyz_reader.py").write_text(f"print('imported')\n{CODE}")
    install(tmp_path, group="scex_sumo.maps", name="xyz", target="stranger:DECLARED", code=code)
    tracks = write_rows(tmp_path / "tracks.csv", straight(1, range(61), start=10.0))
    own = scex(tmp_path, "inspect", a_map(tmp_path), "--tracks", tracks)
    other = scex(tmp_path, "inspect", example_path("roundabout"))
    assert own.returncode == 0 and "imported" in own.stdout, own.stderr
    assert other.returncode == 0 and "imported" not in other.stdout, other.stderr
