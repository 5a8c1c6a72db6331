"""P of the difference between a function and people in one case."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scex_sumo.studies.moments.folder import Failure
from scex_sumo.suites.drive import Contacts
from scex_sumo.suites.suite import Case
from scex_sumo.suites.testing.suite_test import TestFolder, _about, _run, p_alone

FUTURES = 64


def futures(contact: float, collisions: int = 0, *, spread: float = 0.0) -> Any:
    """P of a contact in each of the futures; some collide."""
    chance = contact * np.random.default_rng(0).lognormal(0.0, spread, FUTURES)
    chance[:collisions] = 1.0
    return SimpleNamespace(contacts=Contacts(by_future=chance), collides=chance == 1.0, futures=FUTURES)


def test_the_same_futures_are_no_difference() -> None:
    assert p_alone(futures(1e-6, spread=1.0), futures(1e-6, spread=1.0)) is None


@pytest.mark.parametrize(("collisions", "least", "most"), [(2, 0.05, 0.8), (3, 0.01, 0.2), (5, 0.0, 0.005)])
def test_collisions_where_people_have_none_are_no_chance_from_a_few_on(
    collisions: int, least: float, most: float
) -> None:
    found = p_alone(futures(1e-6, collisions), futures(1e-6))
    assert found is not None and least < found < most


def test_one_future_that_collides_is_no_difference() -> None:
    assert p_alone(futures(1e-6, 1), futures(1e-6)) is None


def test_less_room_in_every_future_is_no_chance_without_any_collision() -> None:
    found = p_alone(futures(1e-3, spread=1.0), futures(1e-5))
    assert found is not None and found < 1e-6


def test_where_people_collide_as_often_collisions_are_no_difference() -> None:
    function = futures(1e-6, 30)
    people = SimpleNamespace(
        **vars(function) | {"contacts": Contacts(by_future=function.contacts.by_future[::-1])}
    )
    found = p_alone(function, people)
    assert found is not None and found > 0.5


def test_a_case_that_is_kept_is_told_to_the_same_bytes(tmp_path: Path) -> None:
    about = {"name": "001-merge", "kind": "merge", "site": "here", "weight": 2.0}
    case, record = Case(folder=tmp_path, about=about), {"probability": 1e-5, "people": 1e-6, "collide": 0.0}
    with TestFolder(tmp_path / "out", {"suite": "s"}) as folder:
        folder.keep(case.name, record)
        kept = folder.record(case.name)
    assert kept is not None and json.dumps(_about(case, kept)) == json.dumps(_about(case, record))


@pytest.mark.parametrize("died", [False, True])
def test_a_case_whose_worker_died_runs_again(
    died: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failure = Failure(moment="001-merge", location="", recording="", reason="why", died=died)

    def run_each(_: object, tasks: Sequence[Any]) -> Iterator[tuple[Any, Failure]]:
        return ((task, failure) for task in tasks)

    workers = nullcontext(SimpleNamespace(run_each=run_each))
    monkeypatch.setattr("scex_sumo.suites.testing.suite_test.MomentWorkers", lambda _: workers)
    task: Any = SimpleNamespace(ref=SimpleNamespace(moment="001-merge"))
    with TestFolder(tmp_path / "out", {"suite": "s"}) as folder:
        assert _run([task], folder, 1, None)["001-merge"]["reason"] == "why"
        assert (folder.record("001-merge") is None) is died
