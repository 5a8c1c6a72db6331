"""Runs with learned drivers: the same bytes however the futures are shared out, and what run.json says."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo as scex
from scex_sumo.base.files import sha256_of
from scex_sumo.extrapolation import job
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from tests.learned import nets
from tests.runs import extrapolate

FUTURES = 9


@pytest.fixture(scope="module")
def scene() -> SeedScene:
    return scex.read_seed(scex.example_path("urban_intersection"))


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory, scene: SeedScene) -> list[str]:
    folder = tmp_path_factory.mktemp("weights")
    assert scene.road is not None
    graph, hybrid = (
        nets.untrained(folder, name, scene, scene.road, hidden=64, heads=4)
        for name in ("graph_predictor", "graph_image_predictor")
    )
    return [
        f"graph_predictor:mode=draw:weights={graph}",
        f"graph_image_predictor:weights={hybrid}",
        f"graph_image_predictor:head=free:weights={hybrid}",
        "standard_driver",
    ]


def ran(scene: SeedScene, models: list[str], out: Path, *, workers: int = 1) -> Run:
    return extrapolate(scene, models=models, futures=FUTURES, steps=10, workers=workers, seed=3, out=out)


def test_batches_and_workers_change_no_byte(
    tmp_path: Path, scene: SeedScene, models: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = ran(scene, models, tmp_path / "first")
    tables = sorted(path.name for path in first.folder.glob("*.parquet"))
    assert "tracks.parquet" in tables
    for batch, workers in ((1, 1), (7, 1), (4, 2)):
        monkeypatch.setattr(job, "VEHICLES_AT_ONCE", batch * scene.vehicles)
        other = ran(scene, models, tmp_path / f"{batch}-{workers}", workers=workers)
        for name in tables:
            assert (other.folder / name).read_bytes() == (first.folder / name).read_bytes(), name


def test_the_result_says_which_weights_drove_and_who_fell_back(
    tmp_path: Path, scene: SeedScene, models: list[str]
) -> None:
    run = ran(scene, models, tmp_path / "out")
    files = {name: Path(name.rpartition("weights=")[2]) for name in models[:3]}
    assert run.info["weights"] == {name: sha256_of(file) for name, file in files.items()}
    assert run.info["fallbacks"] == []  # everybody is on the map
