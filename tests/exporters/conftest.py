"""A finished run of few futures, shared by the tests of all exporters."""

from __future__ import annotations

import pytest

from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.runs import extrapolate


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Four futures of the example intersection."""
    scene = read_seed(example_path("urban_intersection"))
    return extrapolate(scene, futures=4, out=tmp_path_factory.mktemp("run") / "out", seed=3)
