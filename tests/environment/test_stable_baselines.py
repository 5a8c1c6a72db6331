"""Stable-Baselines3 learns in all environments at once; episodes begin again within a step."""

from __future__ import annotations

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import UsageError

pytest.importorskip("gymnasium")
sb3 = pytest.importorskip("stable_baselines3")

from scex_sumo.environment.stable_baselines import StableBaselinesEnv  # noqa: E402
from scex_sumo.environment.vector_env import SeedVectorEnv  # noqa: E402


@pytest.fixture(scope="module")
def scene() -> scex.SeedScene:
    return scex.read_seed(scex.example_path("roundabout"))


def test_steps_are_those_of_the_vector_environment(scene: scex.SeedScene) -> None:
    ours, theirs = SeedVectorEnv(4, seed_scene=scene), StableBaselinesEnv(4, seed_scene=scene)
    theirs.seed(3)
    np.testing.assert_array_equal(theirs.reset(), ours.reset(seed=3)[0])
    for _ in range(10):
        actions = np.zeros((4, 2), dtype=np.float32)
        seen, reward, *_ = ours.step(actions)
        got, rewarded, done, infos = theirs.step(actions)
        np.testing.assert_array_equal(got, seen)
        np.testing.assert_array_equal(rewarded, reward)
        assert not done.any() and infos == [{}] * 4


def test_an_episode_that_ends_begins_again_and_its_last_observation_is_kept(scene: scex.SeedScene) -> None:
    envs = StableBaselinesEnv(3, seed_scene=scene, steps=5)
    first = envs.reset()
    for _ in range(5):
        seen, _, done, infos = envs.step(np.zeros((3, 2), dtype=np.float32))
    assert done.all() and all(info["TimeLimit.truncated"] for info in infos)
    np.testing.assert_allclose(seen, first)  # the seed scene
    assert not np.allclose(infos[0]["terminal_observation"], first[0])
    _, _, done, _ = envs.step(np.zeros((3, 2), dtype=np.float32))
    assert not done.any()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_algorithm_learns_2048_steps(scene: scex.SeedScene) -> None:
    envs = StableBaselinesEnv(16, seed_scene=scene)
    model = sb3.PPO("MlpPolicy", envs, n_steps=32, batch_size=128, n_epochs=2, seed=1, device="cpu")
    model.learn(2048)
    assert model.num_timesteps == 2048
    actions, _ = model.predict(envs.reset(), deterministic=True)
    assert actions.shape == (16, 2) and np.isfinite(actions).all()


def test_named_observations_are_refused(scene: scex.SeedScene) -> None:
    with pytest.raises(UsageError, match="leave it out"):
        StableBaselinesEnv(2, seed_scene=scene, observation="dict")
