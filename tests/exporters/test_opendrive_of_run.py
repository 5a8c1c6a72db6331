"""A map that came as OpenDRIVE leaves as it came, alone and inside a trace."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.opendrive.file import opendrive
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.generators.synthetic import synthetic_seed
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from tests.runs import extrapolate


@pytest.fixture(scope="module")
def hill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A merge on a hill of 5 m, with a place on Earth."""
    file: Path = tmp_path_factory.mktemp("hill") / "hill.xodr"
    text = opendrive(read_map(example_path("motorway_merge"))).text
    header, rest = text.split("</header>", 1) if "</header>" in text else text.split("/>", 1)
    opened = header if "</header>" in text else f"{header}>"
    place = "<geoReference>+proj=utm +zone=32</geoReference><offset x='7' y='8' z='0' hdg='0'/>"
    file.write_text(
        f"{opened}{place}</header>{rest}".replace('elevation s="0" a="0"', 'elevation s="0" a="5"')
    )
    return file


@pytest.fixture(scope="module")
def hill_run(hill: Path) -> Run:
    scene = synthetic_seed(hill, vehicles=3)
    return extrapolate(scene, futures=1, models=["standard_driver"], out=hill.parent / "out")


def test_openscenario_keeps_the_map_and_leaves_heights_to_it(
    hill: Path, hill_run: Run, tmp_path: Path
) -> None:
    pytest.importorskip("scenariogeneration")
    road, scenario = EXPORTERS.load("openscenario")(Request(run=hill_run, futures=(0,), out=tmp_path))
    assert road.read_bytes() == hill.read_bytes()
    places = list(ET.parse(scenario).getroot().iter("WorldPosition"))
    assert places and not any("z" in place.attrib or "p" in place.attrib for place in places)


def test_omega_prime_keeps_the_map_and_its_place_on_earth(hill: Path, hill_run: Run, tmp_path: Path) -> None:
    betterosi = pytest.importorskip("betterosi")
    from scex_sumo.formats.osi import map_text

    (trace,) = EXPORTERS.load("omega-prime")(Request(run=hill_run, futures=(0,), out=tmp_path))
    assert map_text(trace) == hill.read_bytes()
    first = next(iter(betterosi.read(str(trace), return_ground_truth=True)))
    assert first.proj_string == "+proj=utm +zone=32"
    assert (first.proj_frame_offset.position.x, first.proj_frame_offset.position.y) == (7.0, 8.0)
