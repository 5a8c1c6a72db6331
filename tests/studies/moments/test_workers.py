"""Worker processes: what they answer, and what is known when one dies."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import scex_sumo
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, SeedScene, States
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.moments.run import MomentTask, MomentWorkers, StudySettings, built, pack_road
from scex_sumo.studies.rank.rank import run_moment

SETTINGS = StudySettings(run=RunSettings(models="standard_driver,risky_driver", futures=96))


class Deadly:
    """Takes the place of a road, and whoever unpacks it with it; the first time only, where told so."""

    def __init__(self, unless: Path | None = None) -> None:
        self._unless = unless

    def __reduce__(self) -> Any:
        if self._unless is None:
            return os._exit, (3,)
        code = (
            f"import os, pathlib; mark = pathlib.Path({str(self._unless)!r})\n"
            "if not mark.exists(): mark.touch(); os.kill(os.getpid(), 9)"
        )
        return exec, (code,)


@pytest.fixture(scope="module")
def scene() -> SeedScene:
    return scex_sumo.read_seed(scex_sumo.example_path("roundabout"))


def task(scene: SeedScene, name: str, *, road: Any = None, **changed: Any) -> MomentTask:
    ref = MomentRef(moment=name, location="l", recording="r", case="", time_s=1.0, vehicles=scene.vehicles)
    assert scene.road is not None
    return MomentTask(
        ref=ref,
        scene=dataclasses.replace(scene, road=None),
        road=pack_road(scene.road) if road is None else road,
        settings=dataclasses.replace(SETTINGS, **changed),
    )


@pytest.fixture
def workers() -> Iterator[MomentWorkers]:
    with MomentWorkers(1) as processes:
        yield processes


def failure_of(found: pa.Table | Failure) -> Failure:
    assert isinstance(found, Failure)
    return found


def test_what_is_wrong_with_a_seed_is_its_outcome_and_the_next_one_runs(
    workers: MomentWorkers, scene: SeedScene
) -> None:
    away = dataclasses.replace(scene, history=dataclasses.replace(scene.history, x=scene.history.x + 5000.0))
    tasks = [task(away, "away"), task(scene, "good")]
    found = {asked.ref.moment: what for asked, what in workers.run_each(run_moment, tasks)}
    assert "on a mapped lane" in failure_of(found["away"]).reason
    assert isinstance(found["good"], pa.Table)
    assert not failure_of(found["away"]).died


def test_the_seed_of_a_worker_that_died_is_done_again_and_that_is_said(
    workers: MomentWorkers, scene: SeedScene, tmp_path: Path
) -> None:
    mark = tmp_path / "died"
    ((_, found),) = workers.run_each(run_moment, [task(scene, "s", road=Deadly(unless=mark))])
    assert mark.exists()
    failure = failure_of(found)
    assert not failure.died  # the second worker answered: that None is no road
    assert "NoneType" in failure.reason
    assert workers.deaths == ["a worker died at s (signal 9) and was replaced"]


def test_a_seed_that_kills_its_workers_is_given_up_and_the_next_one_runs(
    workers: MomentWorkers, scene: SeedScene
) -> None:
    tasks = [task(scene, "bad", road=Deadly()), task(scene, "good")]
    (bad, first), (_, second) = workers.run_each(run_moment, tasks)
    failure = failure_of(first)
    assert (bad.ref.moment, failure.died) == ("bad", True)
    assert "died 2 times (exit status 3, exit status 3)" in failure.reason
    assert isinstance(second, pa.Table)


def test_tasks_are_not_taken_before_there_is_a_worker_for_them(
    workers: MomentWorkers, scene: SeedScene
) -> None:
    taken: list[int] = []

    def tasks() -> Iterator[MomentTask]:
        for number in range(3):
            taken.append(number)
            yield task(scene, str(number))

    found = workers.run_each(run_moment, tasks())
    next(found)
    assert taken == [0]
    assert len(list(found)) == 2


def models_of(task: MomentTask, scene: SeedScene) -> Sequence[str]:
    return built(task.settings.models).names


def test_an_object_of_ones_own_script_travels_to_the_workers(scene: SeedScene) -> None:
    """Its class is in no module, so that it travels by value."""

    class Standing:
        def plan_one(
            self, history: SceneHistory, road: Road, future: int, vehicle: int, rng: np.random.Generator
        ) -> States:
            now = history.now[future, vehicle]
            x, y, heading = (np.full(30, float(value)) for value in (now.x, now.y, now.heading))
            return States(x=x, y=y, heading=heading, speed=np.zeros(30))

    run = RunSettings(models=[Standing()], futures=96)
    with MomentWorkers(1) as workers:
        ((_, found),) = workers.run_each(models_of, [task(scene, "s", run=run)])
    assert found == ("Standing",)
