"""A finished run of few futures, shared by the tests of all exporters."""

from __future__ import annotations

import subprocess

import pytest

from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.generators.synthetic import synthetic_seed
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.runs import extrapolate


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Four futures of the example intersection."""
    scene = read_seed(example_path("urban_intersection"))
    return extrapolate(scene, futures=4, out=tmp_path_factory.mktemp("run") / "out", seed=3)


@pytest.fixture(scope="session")
def lit_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Grid whose lights have phases for left turns, and begin 7 s late."""
    folder = tmp_path_factory.mktemp("lit")
    shape = ("--grid", "--grid.number", "2", "--grid.attach-length", "120", "--default.lanenumber", "2")
    lights = ("-j", "traffic_light", "--turn-lanes", "1", "--tls.left-green.time", "6")
    netgenerate = [program("netgenerate"), *shape, *lights, "-o", "lit.net.xml"]
    subprocess.run(netgenerate, check=True, capture_output=True, env=environment(), cwd=folder)
    net = folder / "lit.net.xml"
    net.write_text(net.read_text().replace('offset="0"', 'offset="7"'))
    scene = synthetic_seed(net, vehicles=4)
    return extrapolate(scene, futures=1, models=["standard_driver"], out=folder / "out")
