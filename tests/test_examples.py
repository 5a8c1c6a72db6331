"""Public face: the example in the docstring of every public name runs as it stands there."""

from __future__ import annotations

import doctest
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.drivers import registry as models
from scex_sumo.metrics import registry as metrics
from tests.runs import extrapolate

ELSEWHERE = ("__version__", "to_hetero_data")
"""Without an example, and in tests/exporters: the import of PyTorch Geometric takes seconds."""


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the examples use: the package, NumPy, `Path`, and a run of the example roundabout."""
    scene = scex.read_seed(scex.example_path("roundabout"))
    run = extrapolate(scene, futures=4, seed=1, out=tmp_path_factory.mktemp("run") / "out")
    return {"scex": scex, "np": np, "Path": Path, "run": run}


@pytest.mark.filterwarnings("ignore:Implicitly cleaning up:ResourceWarning")
@pytest.mark.parametrize("name", [name for name in scex.__all__ if name not in ELSEWHERE])
def test_the_example_runs(
    name: str, names: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "to_networkx":
        pytest.importorskip("networkx")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(models, "_registered", dict(models._registered))
    monkeypatch.setattr(metrics, "_registered", dict(metrics._registered))
    run_example(name, names)


def run_example(name: str, names: dict[str, Any]) -> None:
    """Run the example of a public name, which may use some names, and compare what it prints."""
    found = getattr(scex, name)
    text = "\n".join(part.__doc__ for part in get_args(found) or (found,))
    example = doctest.DocTestParser().get_doctest(text, dict(names), name, None, 0)
    assert example.examples, "the docstring has no example"
    said: list[str] = []
    failed = doctest.DocTestRunner(verbose=False).run(example, out=said.append).failed
    assert not failed, "".join(said)
