"""Functions submitted to a worker: the result comes, the error is raised, the death is told."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.pool import Pool, WorkersDied, in_other_process
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
from scex_sumo.steps.moment import REFERENCE_FUTURES, run_moment

NEW_PROCESSES = True


def names_of(scene: SeedScene) -> tuple[int, int]:
    """Return which objects a process has as scene and road."""
    return id(scene), id(scene.road)


def test_a_worker_keeps_its_copy_of_a_scene_and_its_road() -> None:
    scene = read_seed(example_path("motorway_merge"))
    other = replace(scene, name="other")
    with Pool(1) as workers:
        asked = [workers.submit(partial(names_of, one), where="once") for one in (scene, scene, other)]
        first, again, third = (one.result() for one in asked)
    assert first == again
    assert third[0] != first[0] and third[1] == first[1]


def test_the_death_of_a_worker_is_told() -> None:
    with Pool(1) as workers:
        done = workers.submit(partial(os._exit, 3), where="over an exit")
        assert isinstance(done.exception(), WorkersDied)
        assert workers.deaths == ["a worker died over an exit (exit status 3) and was replaced"]


def test_run_and_reference_of_two_processes_have_the_same_bytes(tmp_path: Path) -> None:
    scene = read_seed(example_path("motorway_merge"))
    settings = RunSettings(models="rules", futures=117, steps=3)
    for processes in (1, 2):
        with Workers(processes) as workers:
            options = RunOptions(out=tmp_path / str(processes), report=False)
            run = run_moment(scene, settings, workers=workers, options=options)
            assert run.reference is not None and run.reference.futures == REFERENCE_FUTURES
    files = [file.relative_to(tmp_path / "1") for file in (tmp_path / "1").rglob("*.parquet")]
    assert len(files) > 15
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes(), file


def test_a_task_out_of_its_own_time_is_not_tried_again() -> None:
    out_of_time = partial(signal.raise_signal, signal.SIGPROF)
    with pytest.raises(SimulationError, match="endless"):
        in_other_process(out_of_time, where="here", died="died", endless="endless")
    with pytest.raises(SimulationError, match=r"died \(signal 9\)"):
        in_other_process(partial(signal.raise_signal, signal.SIGKILL), where="here", died="died")
    with pytest.raises(SimulationError, match=r"died \(signal 11\)"):
        in_other_process(partial(signal.raise_signal, signal.SIGSEGV), where="here", died="died")
