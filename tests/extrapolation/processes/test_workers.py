"""Functions submitted to a worker: the result comes, the error is raised, the death is told."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.extrapolation import engine
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.pool import Pool, in_other_process, succeeded
from scex_sumo.extrapolation.processes.workers import Workers, kept_workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.parts import Parts
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
from scex_sumo.steps.moment import run_moment

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


def test_a_worker_that_dies_twice_leaves_it_to_others() -> None:
    with Pool(1) as workers:
        done = workers.submit(partial(os._exit, 3), where="over an exit")
        assert not succeeded(done)
        assert workers.deaths == ["a worker died over an exit (exit status 3) and was replaced"]


def test_run_and_reference_of_two_processes_have_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = []

    def finish(scene: SeedScene, settings: RunSettings, *, options: RunOptions, **others: Any) -> Run:
        simulated.append(len(Parts(Path(str(options.out))).futures))
        return run_scene(scene, settings, options=options, **others)

    monkeypatch.setattr("scex_sumo.steps.reference.run_scene", finish)
    scene = read_seed(example_path("motorway_merge"))
    settings = RunSettings(models="rules", futures=117, steps=3)
    for processes in (1, 2):
        with Workers(processes) as workers:
            options = RunOptions(out=tmp_path / str(processes), report=False)
            run = run_moment(scene, settings, workers=workers, options=options)
            assert run.reference is not None and run.reference.futures == 64
    assert simulated == [0, 64]  # a worker simulates the reference meanwhile
    files = [file.relative_to(tmp_path / "1") for file in (tmp_path / "1").rglob("*.parquet")]
    assert len(files) > 15
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes(), file


def test_a_reference_ahead_ends_after_the_batch_when_the_run_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, settings = read_seed(example_path("motorway_merge")), RunSettings(futures=3, steps=1)
    monkeypatch.setattr(engine, "VEHICLES_AHEAD", scene.vehicles)  # a future in each batch
    for name, futures in (("not yet", 3), (".", 1)):
        options = RunOptions(out=tmp_path / f"out {futures}")
        models = ModelSet.of(settings)
        engine.simulate_ahead(scene, settings, models, options, enough=tmp_path / name)
        assert len(Parts(tmp_path / f"out {futures}").futures) == futures


def test_kept_workers_stay_for_the_next_run_in_the_same_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def worker() -> Any:
        with kept_workers(2) as workers:
            done = workers.submit(os.getpid, where="at home")
            assert done is not None
            return done.result()

    first, again = worker(), worker()
    monkeypatch.chdir(tmp_path)
    elsewhere = worker()
    with pytest.raises(ZeroDivisionError), kept_workers(2):
        raise ZeroDivisionError
    assert first == again and len({first, elsewhere, worker()}) == 3


def test_a_worker_with_a_function_to_do_is_not_free() -> None:
    with Workers(2) as workers:
        assert workers.free == 2
        done = workers.submit(partial(time.sleep, 0.1), where="asleep")
        assert done is not None
        assert workers.free == 1 and workers.submit(os.getpid, where="nowhere") is None
        later = workers.submit(os.getpid, where="later", waits=True)
        assert later is not None and later.result() != os.getpid()
        assert succeeded(done) and workers.free == 2


def test_a_task_out_of_its_own_time_is_not_tried_again() -> None:
    out_of_time = partial(signal.raise_signal, signal.SIGPROF)
    with pytest.raises(SimulationError, match="endless"):
        in_other_process(out_of_time, where="here", died="died", endless="endless")
    with pytest.raises(SimulationError, match=r"died \(signal 9\)"):
        in_other_process(partial(signal.raise_signal, signal.SIGKILL), where="here", died="died")
    with pytest.raises(SimulationError, match=r"died \(signal 11 in \S+ < serve < <module>\)"):
        in_other_process(partial(signal.raise_signal, signal.SIGSEGV), where="here", died="died")
