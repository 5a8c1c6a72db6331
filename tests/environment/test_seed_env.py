"""Gymnasium environments: the interface, the physics, the same drivers as a run, and a training."""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import UsageError
from scex_sumo.scene import States
from tests.environment.drivers import as_in_a_run
from tests.runs import extrapolate

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from scex_sumo.environment import SEED_ENV, vector_env  # noqa: E402
from scex_sumo.environment.agent import controlled  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def scene() -> scex.SeedScene:
    return scex.read_seed(scex.example_path("roundabout"), time=4.5)


@pytest.mark.parametrize(
    "options", [{}, {"observation": "dict"}, {"action": "plan", "hold": 5}, {"models": "likely"}], ids=str
)
def test_gymnasium_accepts_it(scene: scex.SeedScene, options: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # Gymnasium prefers actions within -1 and 1
        check_env(gymnasium.make(SEED_ENV, seed_scene=scene, **options).unwrapped)


def test_the_others_drive_as_in_a_run(
    scene: scex.SeedScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An agent that repeats a run's driver: the others end where they end in that run's futures."""
    count, agent = 24, 6
    place = scene.track_ids.tolist().index(agent)
    monkeypatch.setattr(vector_env, "random_assignments", as_in_a_run(place))
    run = extrapolate(
        scene,
        futures=count,
        seed=3,
        models="rules",
        assign={agent: "constant_velocity"},
        out=tmp_path / "run",
    )
    states = States.stack([run.states(future) for future in range(count)], axis=0)[:, :, -30:]
    track, now = states[:, place], scene.now[place]
    envs = gymnasium.make_vec(
        SEED_ENV, num_envs=count, seed_scene=scene, agent=agent, models="rules", action="plan", hold=1
    )
    envs.reset(seed=3)
    hits = np.full(count, -1)
    x, y, heading = (np.full(count, v) for v in (now.x, now.y, now.heading))
    for step in range(30):
        dx, dy = track.x[:, step] - x, track.y[:, step] - y
        cos, sin = np.cos(heading), np.sin(heading)
        _, _, terminated, _, _ = envs.step(np.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)[:, None])
        mine = envs.unwrapped._agent_now()
        x, y, heading = mine.x, mine.y, mine.heading
        hits[terminated & (hits < 0)] = step
    calm = hits < 0
    here = envs.unwrapped._window[calm, :, -1]
    others = np.arange(scene.vehicles) != place
    assert calm.any()
    assert np.abs(here.x - states.x[calm, :, 29])[:, others].max() < 0.05
    assert np.abs(here.y - states.y[calm, :, 29])[:, others].max() < 0.05
    table = run.collisions.to_pydict()
    pairs = zip(table["future"], table["track_id"], table["other_id"], strict=True)
    hit = {future for future, *pair in pairs if agent in pair}
    assert set(np.flatnonzero(~calm).tolist()) == hit


def test_a_collision_ends_the_episode_and_the_next_step_begins_another(scene: scex.SeedScene) -> None:
    envs = gymnasium.make_vec(SEED_ENV, num_envs=8, seed_scene=scene, agent=8, steps=40)
    first, info = envs.reset(seed=0)
    assert info["future"].tolist() == list(range(8))
    ended = np.zeros(8, dtype=bool)
    for _ in range(40):
        seen, reward, terminated, truncated, info = envs.step(np.tile([1.0, 0.0], (8, 1)))
        begun = ended
        assert (reward[begun] == 0).all() and (info["step"][begun] == 0).all()
        assert np.array_equal(seen[begun][:, -1], first[begun][:, -1])
        assert (reward[terminated] < -5).all()
        ended = terminated | truncated
    assert (info["future"] >= 8).any()  # full throttle in a roundabout ends early


def test_the_kinematic_bicycle_drives_a_circle() -> None:
    """Radius of the centre: half the wheelbase over the sine of the slip angle."""
    now = States(
        **{name: np.array([v]) for name, v in {"x": 0.0, "y": 0.0, "heading": 0.0, "speed": 5.0}.items()}
    )
    length = np.array([5.0])
    places = []
    for _ in range(200):
        now = controlled(now, length, np.array([[0.0, 0.6]]))
        places.append([now.x[0], now.y[0]])
    slip = np.arctan(np.tan(0.3) / 2)
    radius = 1.5 / np.sin(slip)
    centre = np.array([-radius * np.sin(slip), radius * np.cos(slip)])
    assert np.abs(np.hypot(*(np.array(places) - centre).T) - radius).max() < 0.02
    braked = controlled(now, length, np.array([[-5.0, 0.0]]))
    assert braked.speed[0] == pytest.approx(5.0 - 0.8)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"agent": 99}, "no vehicle 99"),
        ({"models": "sumo:EIDM"}, "SUMO drives"),
        ({"assign": {3: "standard_driver"}}, "is the agent"),
        ({"hold": 31}, "hold: got 31, needs a whole number from 1 to 30"),
        ({"num_envs": 0}, "num_envs: got 0, needs a whole number from 1"),
        ({"num_envs": 1.5}, "num_envs: got 1.5"),
        ({"replan": 1.5}, "replan: got 1.5"),
        ({"steps": True}, "steps: got True"),
        ({"action": "x"}, "action: unknown 'x'; known: control, plan"),
        ({"observation": "x"}, "observation: unknown 'x'; known: flat, dict"),
        ({"path": 99}, "path of vehicle 3: got 99, needs a whole number from -4 to 3"),
        ({"path": "straight"}, "path of vehicle 3: got 'straight'"),
        ({"assign": {999: "standard_driver"}}, "assign: no vehicle 999"),
        ({"assign": {9: None}}, "got None as a model"),
        ({"assign": "standard_driver"}, "assign: got str, needs a mapping"),
        ({"models": 5}, "got 5 as a model"),
        ({"reward": 1.0}, "reward: got 1.0, needs a function"),
        ({"surroundings": 8}, "surroundings: got 8"),
        ({"seed_scene": 5}, "seed_scene: got int"),
    ],
)
def test_bad_arguments(scene: scex.SeedScene, options: dict[str, Any], said: str) -> None:
    from scex_sumo.environment.vector_env import SeedVectorEnv

    with pytest.raises(UsageError, match=said):
        SeedVectorEnv(**{"seed_scene": scene, "num_envs": 2, **options})


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        (np.full((2, 2), np.nan), "4 values that are not finite"),
        (np.zeros((2, 2)) * 1j, "type complex128, needs real numbers"),
        ([["a", "b"], ["c", "d"]], "needs real numbers"),
        ([[1], [1, 2]], "rows of different lengths"),
        (None, "needs real numbers"),
        (np.zeros(3), r"shape \(3,\), needs \(2, 2\)"),
    ],
)
def test_bad_actions(scene: scex.SeedScene, actions: Any, said: str) -> None:
    envs = gymnasium.make_vec(SEED_ENV, num_envs=2, seed_scene=scene)
    envs.reset(seed=0)
    with pytest.raises(UsageError, match=f"actions: got .*{said}"):
        envs.step(actions)
    one = gymnasium.make(SEED_ENV, seed_scene=scene, disable_env_checker=True)
    one.reset(seed=0)
    with pytest.raises(UsageError, match="actions: got"):
        one.step("x")


def test_the_example_learns(scene: scex.SeedScene) -> None:
    """A few rounds of docs/examples/train_agent.py beat no training, with drivers never met."""
    spec = importlib.util.spec_from_file_location("train_agent", REPOSITORY / "docs/examples/train_agent.py")
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    envs = gymnasium.make_vec(
        SEED_ENV, num_envs=96, seed_scene=scene, agent=11, models="rules", observation="dict", hold=5
    )
    trained = example.train(envs, rounds=6)
    assert example.mean_return(envs, trained) > example.mean_return(envs, 0 * trained) + 0.5
