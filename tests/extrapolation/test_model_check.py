"""A driver of a user's is checked: what is wrong is named, and what is sound passes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import scex

DRIVERS = """
import numpy as np
import scex_sumo as scex


def straight(history, who, faster=0.0, steps=30):
    now = history.now[who.future, who.vehicle].map(lambda values: values[:, None])
    way = 0.1 * now.speed * np.arange(1, steps + 1) * (1 + faster)
    return scex.Plan(
        x=now.x + way * np.cos(now.heading), y=now.y + way * np.sin(now.heading),
        heading=now.heading + 0 * way, speed=now.speed + 0 * way,
    )


class Sound:
    def plan(self, history, road, who, rng):
        mine = np.array([rng[future].random() for future in who.future])
        return straight(history, who, 0.01 * mine[:, None])


class HiddenRandom:
    def plan(self, history, road, who, rng):
        return straight(history, who, 0.01 * np.random.rand(len(who), 1))


class OneForAll:
    def plan(self, history, road, who, rng):
        return straight(history, who, 0.01 * rng[0].random((len(who), 1)))


class Short:
    def plan(self, history, road, who, rng):
        return straight(history, who, steps=5)


class Raises:
    def plan(self, history, road, who, rng):
        return {}["plan"]


class Infinite:
    def plan(self, history, road, who, rng):
        plan = straight(history, who)
        plan.x[:, 7] = np.inf
        return plan


def predicts(history):
    way = 0.1 * history[:, -1, 4:] * np.arange(1, 31)
    return np.stack([way, np.zeros_like(way)], axis=-1)
"""


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drivers")
    (folder / "mine.py").write_text(DRIVERS)
    return folder


@pytest.mark.parametrize("model", ["mine:Sound", "mine:predicts", "standard_driver"])
def test_a_sound_driver_passes_with_its_seconds(model: str, where: Path) -> None:
    done = scex("models", model, "--check", cwd=where)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"{model}: 84 plans" in done.stdout and " ms each" in done.stdout and "sound" in done.stdout


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ("mine:HiddenRandom", "84 of 84 plans differ when the same is asked again: draw from rng"),
        ("mine:OneForAll", "42 of 42 plans differ in a batch of 3 other futures"),
        ("mine:Short", "plan.x has shape (84, 5), needs (84, 30) or more steps"),
        ("mine:Raises", "raised KeyError: 'plan' (mine.py, line"),
        ("mine:Infinite", "84 of 84 plans are unusable: plan.x is not finite"),
        ("sumo:EIDM", "give one driver"),
    ],
)
def test_what_is_wrong_with_a_driver_is_one_line(model: str, says: str, where: Path) -> None:
    done = scex("models", model, "--check", cwd=where)
    assert done.returncode in (1, 2)
    assert says in done.stderr and done.stderr.count("\n") == 1
