"""A policy drives in runs and test suites as it does in its environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from tests.environment.drivers import as_in_a_run
from tests.runs import extrapolate

gymnasium = pytest.importorskip("gymnasium")

from scex_sumo.environment import SEED_ENV, vector_env  # noqa: E402
from scex_sumo.environment.policy import PolicyDriver  # noqa: E402

AGENT = 6


@pytest.fixture(scope="module")
def scene() -> scex.SeedScene:
    return scex.read_seed(scex.example_path("roundabout"), time=4.5)


def steered(seen: dict[str, Any]) -> Any:
    """Towards the path 9 m ahead, at 6 m/s."""
    x, y = seen["path"][:, 2].T
    return np.stack([(6.0 - seen["history"][:, -1, 4]) / 8, np.arctan2(y, x)], axis=1).clip(-1, 1)


class Predicts:
    """As Stable-Baselines3 has it."""

    def predict(self, seen: Any, deterministic: bool = False) -> tuple[Any, None]:
        assert deterministic
        return steered(seen), None


def straight(seen: Any) -> Any:
    """Positions of the next 0.5 s."""
    way = seen["history"][:, -1, 4:] * 0.1 * np.arange(1, 6)
    return np.stack([way, np.zeros_like(way)], axis=-1)


@pytest.mark.parametrize(("policy", "action"), [(Predicts(), "control"), (straight, "plan")])
def test_it_drives_as_in_its_environment(
    scene: scex.SeedScene, policy: Any, action: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Same drivers of the others, actions held for 0.5 s in both."""
    monkeypatch.setattr(vector_env, "random_assignments", as_in_a_run())
    driver = PolicyDriver(policy, action=action, observation="dict")
    options: dict[str, Any] = {"models": "rules", "steps": 30}
    run = extrapolate(scene, futures=4, seed=3, assign={AGENT: driver}, out=tmp_path / "run", **options)
    place = scene.track_ids.tolist().index(AGENT)
    envs = gymnasium.make_vec(
        SEED_ENV,
        num_envs=4,
        seed_scene=scene,
        agent=AGENT,
        action=action,
        hold=5,
        observation="dict",
        **options,
    )
    drives, (seen, _) = np.ones(4, dtype=np.bool_), envs.reset(seed=3)
    for step in range(5, 31, 5):
        asked = policy.predict(seen, deterministic=True)[0] if action == "control" else policy(seen)
        seen, _, ended, *_ = envs.step(asked)
        drives &= ~ended
        for future in np.flatnonzero(drives).tolist():
            states = run.states(future)
            at = states[place, states.shape[1] - 31 + step]
            now = envs.unwrapped._agent_now()[future]
            assert np.allclose([at.x, at.y, at.speed], [now.x, now.y, now.speed], atol=1e-6)
    assert drives.any()


def test_a_wrong_policy_is_one_line(scene: scex.SeedScene, tmp_path: Path) -> None:
    with pytest.raises(scex.ScexError, match="policy: got int, needs a function or an object with predict"):
        PolicyDriver(3)
    with pytest.raises(scex.ScexError, match="action: unknown 'brake'; known: control, plan"):
        PolicyDriver(straight, action="brake")  # type: ignore[arg-type]
    wrong = PolicyDriver(lambda seen: np.zeros((len(seen), 3)))
    with pytest.raises(scex.ScexError, match=r"actions of the policy: got shape \(1, 3\), needs \(1, 2\)"):
        extrapolate(scene, futures=2, assign={AGENT: wrong}, models="rules", out=tmp_path / "run")
