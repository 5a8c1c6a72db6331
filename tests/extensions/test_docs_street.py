"""The package of the docs (a recording in feet, a map of polylines, an exporter) is used by its names."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.command import ALONE
from tests.extensions.package import scex

EXAMPLE = Path(__file__).resolve().parents[2] / "docs/examples/street"
HEADER = "Vehicle,Class,Seconds,East_ft,North_ft,Heading_deg,Speed_mph,Length_ft,Width_ft"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as site-packages with the example, its entry points those of its pyproject.toml."""
    if sys.version_info < (3, 11):
        pytest.skip("tomllib came with Python 3.11")
    import tomllib

    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())
    for module in project["tool"]["setuptools"]["py-modules"]:
        shutil.copy(EXAMPLE / f"{module}.py", folder)
    info = folder / "street-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: street\nVersion: 1.0\n")
    groups = project["project"]["entry-points"].items()
    (info / "entry_points.txt").write_text(
        "\n".join(
            f"[{group}]\n" + "\n".join(f"{name} = {target}" for name, target in named.items())
            for group, named in groups
        )
    )
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two lanes in a row to the east, 400 m; a car at 10 m/s, 100 ft behind a truck, and a tram."""
    folder = tmp_path_factory.mktemp("recorded")
    lanes = {
        "1": {"line": [[0, 0], [200, 0]], "width": 3.5, "kmh": 50, "next": [2]},
        "2": {"line": [[200, 0], [400, 0]], "width": 3.5, "kmh": 50, "next": []},
    }
    (folder / "main.street.json").write_text(json.dumps({"lanes": lanes}))
    rows = [
        f"{car},{kind},{k / 10:.1f},{feet + k / 0.3048:.3f},0.0,90.0,{10 / 0.44704:.4f},15.0,6.0"
        for car, kind, feet in ((1, "PC", 100.0), (2, "HGV", 200.0), (3, "TRAM", 600.0))
        for k in range(61)
    ]
    (folder / "morning.csv").write_text("\n".join([HEADER, *rows, ""]))
    return folder


def test_feet_become_metres_and_unknown_classes_are_said(installed: Path, recorded: Path) -> None:
    done = scex(
        installed, "inspect", recorded / "main.street.json", "--tracks", recorded / "morning.csv", "--json"
    )
    assert done.returncode == 0, done.stderr
    assert "61 samples of unknown classes left out" in done.stdout + done.stderr


def test_a_future_is_exported_in_feet_and_read_again(installed: Path, recorded: Path, tmp_path: Path) -> None:
    run = ("run", recorded / "main.street.json", "--tracks", recorded / "morning.csv", "--time", 2.0)
    options = ("--futures", 1, "--models", "constant_velocity", *ALONE, "-o", tmp_path / "out")
    done = scex(installed, *run, *options)
    assert done.returncode == 0, done.stderr
    file = tmp_path / "future.csv"
    done = scex(installed, "export", tmp_path / "out", "--future", 0, "--to", "street", "-o", file)
    assert done.returncode == 0, done.stderr
    assert file.read_text().splitlines()[0] == HEADER
    car = [line.split(",") for line in file.read_text().splitlines() if line.startswith("1,PC")]
    east = np.array([float(row[3]) for row in car]) * 0.3048
    assert np.allclose(np.diff(east), 1.0, atol=0.01)  # 10 m/s
    again = scex(installed, "inspect", recorded / "main.street.json", "--tracks", file)
    assert again.returncode == 0 and "2 vehicles" in again.stdout, again.stderr
