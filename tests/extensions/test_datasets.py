"""A dataset of another package is one file: inspected, found below a folder, and ranked."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.converters.maps import straight, write_map
from tests.extensions.package import install, scex

CODE = '''
import numpy as np
from scex_sumo import Recording, TrackTable, track_rows


def is_mine(path):
    return path.suffix == ".cars"


def recordings(files):
    for path in files:
        yield Recording(name=path.stem, site="street", dataset="cars", map_path=path.with_name("street.osm"),
                        track_paths=(path,))


def read(paths, **options):
    """A line for each sample: car, time in s, x in m, speed in m/s; all drive along x."""
    car, time, x, speed = np.loadtxt(paths[0], unpack=True)
    ids, track = np.unique(car.astype(int), return_inverse=True)
    still = np.zeros(len(x))
    rows = track_rows(
        track, [str(i) for i in ids], ["car"] * len(ids), timestamp_ms=1000.0 * time, x=x, y=still, vx=speed,
        vy=still, psi_rad=still, length=still + 4.5, width=still + 1.8,
    )
    none = rows.take(np.zeros(len(rows), bool))
    return TrackTable(path=paths[0], cases=("",), vehicles=rows, others=none, step_s=0.1), ()
'''


def a_street(folder: Path) -> Path:
    """A folder with a map and a recording of two cars."""
    street = folder / "streets"
    street.mkdir()
    write_map(street / "street.osm", [straight(1, -50.0, 400.0, -1.75)])
    samples = [(k, 0.1 * n, 30.0 * k + n, 10.0) for k in (1, 2) for n in range(81)]
    (street / "morning.cars").write_text("\n".join(" ".join(map(str, row)) for row in samples))
    return street


def test_a_recording_of_another_packages_dataset_is_inspected(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.datasets", name="cars", target="stranger", code=CODE)
    street = a_street(tmp_path)
    done = scex(tmp_path, "inspect", street / "street.osm", "--tracks", street / "morning.cars")
    assert done.returncode == 0, done.stderr
    assert "street_morning: 2 vehicles in 8.0 s" in done.stdout


def test_a_reader_that_draws_at_random_is_told_by_inspect(tmp_path: Path) -> None:
    code = CODE.replace("still = np.zeros(len(x))", "still = 0.01 * np.random.random(len(x))")
    install(tmp_path, group="scex_sumo.datasets", name="cars", target="stranger", code=code)
    street = a_street(tmp_path)
    done = scex(tmp_path, "inspect", street / "street.osm", "--tracks", street / "morning.cars")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "dataset cars: read returned something else when called again" in done.stderr


def test_a_folder_of_another_packages_dataset_is_ranked(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.datasets", name="cars", target="stranger", code=CODE)
    options = ("--futures", 2, "--every", 2, "--workers", 1, "-o", tmp_path / "out")
    done = scex(tmp_path, "rank", a_street(tmp_path), *options)
    assert done.returncode == 0, done.stderr
    assert "morning" in (tmp_path / "out/moments.csv").read_text()


@pytest.mark.parametrize(
    ("line", "function"), [("    car, time", "read"), ("    for path in files", "recordings")]
)
def test_an_error_of_a_dataset_is_one_line_with_its_line(line: str, function: str, tmp_path: Path) -> None:
    code = CODE.replace(line, f"    {{}}['line']\n{line}")
    install(tmp_path, group="scex_sumo.datasets", name="cars", target="stranger", code=code)
    done = scex(tmp_path, "rank", a_street(tmp_path), "-o", tmp_path / "out")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert f"dataset cars: {function} raised KeyError: 'line' (stranger.py, line" in done.stderr


REPAIR = """

def repair(table):
    from dataclasses import replace
    x = table.vehicles.x.copy()
    x[50] = np.nan
    return replace(table, vehicles=table.vehicles.with_columns(x=x)), ()
"""


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (
            CODE.replace("length=still", "length=still * np.nan"),
            "length of track 1 is missing; repair the row, or leave it out",
        ),
        (
            CODE.replace("width=still", "width=still * np.nan"),
            "width of track 1 is missing; repair the row, or leave it out",
        ),
        (CODE + REPAIR, "x of track 1 is missing; repair the row, or leave it out"),
    ],
)
def test_no_number_of_a_dataset_is_one_line(code: str, said: str, tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.datasets", name="cars", target="stranger", code=code)
    street = a_street(tmp_path)
    done = scex(tmp_path, "inspect", street / "street.osm", "--tracks", street / "morning.cars")
    assert (done.returncode, done.stderr) == (1, f"error: {street}/morning.cars: {said}\n")
