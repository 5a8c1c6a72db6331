"""Worker processes: what they answer, and what is known when one dies."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.ranking.seeds import SeedRef
from scex_sumo.ranking.task import Parcel, SeedPart, SeedTask, Settings
from scex_sumo.ranking.workers import Order, Processes
from scex_sumo.scene import SeedScene

SETTINGS = Settings(
    models=("standard_driver", "risky_driver"),
    weights=(),
    steps=30,
    replan=5,
    design="balanced",
    seed=0,
    thresholds=(("wttc", 0.26), ("ttc", 1 / 1.5)),
    keep="none",
)


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


def order(scene: SeedScene, name: str, *, children: int = 4, parcel: Any = None, **changed: Any) -> Order:
    ref = SeedRef(seed=name, location="l", recording="r", case="", time_s=1.0, vehicles=scene.vehicles)
    assert scene.road is not None
    task = SeedTask(
        seed=name,
        scene=dataclasses.replace(scene, road=None),
        first=0,
        stop=children,
        spare=children,
        settings=dataclasses.replace(SETTINGS, **changed),
    )
    return Order(ref=ref, task=task, parcel=Parcel.of(scene.road) if parcel is None else parcel)


@pytest.fixture
def crew() -> Iterator[Processes]:
    processes = Processes(1)
    yield processes
    processes.close()


def part_of(crew: Processes, asked: Order) -> SeedPart:
    (found,) = crew.run([asked])
    assert found.part is not None, found.reason
    return found.part


def test_a_seed_gives_what_extrapolate_gives(crew: Processes, scene: SeedScene, tmp_path: Path) -> None:
    part = part_of(crew, order(scene, "s", keep="all"))
    run = scex_sumo.extrapolate(scene, models=list(SETTINGS.models), children=4, out=tmp_path / "out")
    for index, column in enumerate(COLUMNS):
        expected = run.metrics[column].to_numpy(zero_copy_only=False)
        assert np.array_equal(part.values[:, index], expected, equal_nan=True), column
    assert part.tracks is not None
    assert part.tracks.equals(run.tracks)
    assert [list(row) for row in part.models] == [run.models_of(child) for child in range(4)]


def test_later_children_are_those_of_a_longer_run(crew: Processes, scene: SeedScene) -> None:
    whole = order(scene, "s", children=6)
    later = dataclasses.replace(whole, task=dataclasses.replace(whole.task, first=4))
    all_of_them, last = (part_of(crew, asked) for asked in (whole, later))
    assert last.children.tolist() == [4, 5]
    assert np.array_equal(last.values, all_of_them.values[4:], equal_nan=True)


def test_what_is_wrong_with_a_seed_is_its_outcome_and_the_next_one_runs(
    crew: Processes, scene: SeedScene
) -> None:
    away = dataclasses.replace(scene, history=dataclasses.replace(scene.history, x=scene.history.x + 5000.0))
    other = dataclasses.replace(order(scene, "other").task, version="0.0.0")
    orders = [
        order(away, "away"),
        dataclasses.replace(order(scene, "other"), task=other),
        order(scene, "good"),
    ]
    found = {outcome.order.ref.seed: outcome for outcome in crew.run(orders)}
    assert "on a mapped lane" in found["away"].reason
    assert "needs 0.0.0" in found["other"].reason
    assert found["good"].part is not None
    assert not any(outcome.died for outcome in found.values())


def test_the_seed_of_a_worker_that_died_is_done_again(
    crew: Processes, scene: SeedScene, tmp_path: Path
) -> None:
    mark = tmp_path / "died"
    (found,) = crew.run([order(scene, "s", parcel=Deadly(unless=mark))])
    assert mark.exists()
    assert not found.died  # the second worker answered: that None is no road
    assert "AttributeError" in found.reason


def test_a_seed_that_kills_its_workers_is_given_up_and_the_next_one_runs(
    crew: Processes, scene: SeedScene
) -> None:
    first, second = crew.run([order(scene, "bad", parcel=Deadly()), order(scene, "good")])
    assert (first.order.ref.seed, first.part, first.died) == ("bad", None, True)
    assert "died 2 times (exit status 3, exit status 3)" in first.reason
    assert second.part is not None


def test_orders_are_not_taken_before_there_is_a_worker_for_them(crew: Processes, scene: SeedScene) -> None:
    taken: list[int] = []

    def orders() -> Iterator[Order]:
        for number in range(3):
            taken.append(number)
            yield order(scene, str(number), children=1)

    outcomes = crew.run(orders())
    next(outcomes)
    assert taken == [0]
    assert len(list(outcomes)) == 2


LAZY = """
import numpy as np


def lazy(history):
    \"\"\"Stays where it is; has no plan for the first vehicle.\"\"\"
    plan = np.zeros((len(history), 30, 2))
    plan[0] = np.nan
    return plan
"""


def test_plans_that_are_not_the_models_own_are_counted(
    scene: SeedScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One vehicle without a plan, at each of the 6 replans of each of the 2 children."""
    (tmp_path / "lazy_drivers.py").write_text(LAZY)
    monkeypatch.syspath_prepend(tmp_path)
    crew = Processes(1)
    try:
        part = part_of(crew, order(scene, "s", children=2, models=("lazy_drivers:lazy",)))
    finally:
        crew.close()
    assert part.fallbacks.tolist() == [6, 6]
