"""A dataset of another package may have signal phases: they become the lights of a net."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo import example_path
from tests.extensions.package import install, scex

CODE = """
from scex_sumo.lanelet2sumo.plan.elements import Programme


def is_mine(path):
    return path.suffix == ".phases"


def read(paths, net=None):
    raise NotImplementedError


def phases(layout, origin, path):
    seconds = float(path.read_text())
    links = tuple(layout.connections)
    return Programme(name="theirs", connections=links, phases=((seconds, "r" * len(links)),)), ["all red"]


signals = phases
"""


@pytest.fixture
def command(tmp_path: Path) -> list[object]:
    (tmp_path / "red.phases").write_text("17")
    where = ("--signals", tmp_path / "red.phases", "-o", tmp_path / "x.net.xml")
    return ["convert", example_path("urban_intersection"), *where]


def test_signals_of_another_packages_dataset_are_the_lights_of_the_net(
    tmp_path: Path, command: list[object]
) -> None:
    install(tmp_path, group="scex_sumo.datasets", name="phases", target="stranger", code=CODE)
    done = scex(tmp_path, *command)
    assert "note: all red" in done.stderr.splitlines()
    net = (tmp_path / "x.net.xml").read_text()
    assert '<tlLogic id="theirs"' in net and 'duration="17"' in net


def test_a_file_of_no_known_format_is_one_line(tmp_path: Path, command: list[object]) -> None:
    done = scex(tmp_path, *command)
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert "red.phases: not a recording of signal phases; give a CSV with the column signal_group_id" in line
