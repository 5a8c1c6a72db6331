"""What a worker does beside: its result comes, its error is raised, its death is told."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pytest

from scex_sumo.errors import ResultError
from scex_sumo.extrapolation.extrapolate import extrapolate
from scex_sumo.extrapolation.reference import add_reference, begin_reference
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
