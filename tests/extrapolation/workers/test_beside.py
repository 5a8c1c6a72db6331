"""What a worker does beside: its result comes, its error is raised, its death is told."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.net.convert import convert
from scex_sumo.errors import ResultError
from scex_sumo.extrapolation.extrapolate import extrapolate
from scex_sumo.extrapolation.job import Job, batch_size
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.reference import add_reference, begin_reference
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.workers.pool import Workers, ended_well
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed


def refuse() -> None:
    """Raise an error of ours."""
    raise ResultError("disk: full")


def test_a_worker_does_it_and_takes_its_next_task() -> None:
    with Workers(2) as workers:
        first, second = workers.beside(os.getpid, where="once"), workers.beside(os.getpid, where="twice")
        assert first is not None and second is not None
        assert first.result() == second.result() != os.getpid()
        assert ended_well(first) and workers.deaths == []


def test_without_workers_nobody_does_it() -> None:
    with Workers(1) as workers:
        assert workers.beside(os.getpid, where="nowhere") is None


def test_its_error_is_raised_where_it_is_waited_for() -> None:
    with Workers(2) as workers:
        done = workers.beside(refuse, where="over a disk")
        assert done is not None
        with pytest.raises(ResultError, match="disk: full"):
            ended_well(done)


def test_a_worker_that_dies_twice_leaves_it_to_others() -> None:
    with Workers(2) as workers:
        done = workers.beside(partial(os._exit, 3), where="over an exit")
        assert done is not None and not ended_well(done)
        assert workers.deaths == ["a worker died over an exit (exit status 3) and was replaced"]


def test_a_reference_beside_a_run_has_the_same_bytes(tmp_path: Path) -> None:
    scene = read_seed(example_path("motorway_merge"))
    settings = {"models": "rules", "children": 117, "steps": 3}
    alone = extrapolate(scene, out=tmp_path / "alone", **settings)
    add_reference(alone, scene, "likely", **settings)
    with Workers(2) as workers:
        likely = []

        def begun(folder: Path, children: int) -> None:
            likely.append(begin_reference(folder, children, scene, "likely", workers=workers, **settings))

        run = extrapolate(scene, out=tmp_path / "both", workers=workers, begun=begun, **settings)
        assert likely[0] is not None
        reference = add_reference(run, scene, "likely", begun=likely[0], workers=workers, **settings)
    assert reference.children == 117
    files = [file.relative_to(tmp_path / "alone") for file in (tmp_path / "alone").rglob("*.parquet")]
    assert len(files) > 15
    for file in files:
        assert (tmp_path / "alone" / file).read_bytes() == (tmp_path / "both" / file).read_bytes(), file


def test_a_reference_that_would_keep_a_worker_longest_is_run_by_all() -> None:
    scene = read_seed(example_path("motorway_merge"))
    with Workers(2) as workers:
        assert begin_reference(Path("out"), 116, scene, "likely", workers=workers) is None


@pytest.mark.parametrize(
    ("models", "children", "batches"), [("rules", 385, 1), ("rules", 900, 4), ("graph_predictor", 385, 4)]
)
def test_children_are_not_cut_for_a_worker_that_a_reference_keeps_longer(
    models: str, children: int, batches: int, tmp_path: Path
) -> None:
    scene = read_seed(example_path("motorway_merge"))
    settings = RunSettings(models=models, children=children)
    assert scene.road is not None
    net = convert(scene.road, tmp_path / "a.net.xml")
    assignment = np.zeros((children, scene.vehicles), dtype=np.int64)
    job = Job(scene, net, settings, ModelSet.of(settings), assignment, tmp_path)
    assert -(-children // batch_size(job, processes=2, occupied=1)) == batches
    assert -(-children // batch_size(job, processes=2)) == 4
