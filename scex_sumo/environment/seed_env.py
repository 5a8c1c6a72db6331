"""Single environment, for what takes no vector environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from scex_sumo.environment.vector_env import SeedVectorEnv


class SeedEnv(gymnasium.Env[Any, Any]):
    """One future of a seed scene; arguments, actions and observations as `SeedVectorEnv`."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, **arguments: Any) -> None:
        self._one = SeedVectorEnv(1, **arguments)
        self.action_space = self._one.single_action_space
        self.observation_space = self._one.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Put the scene back, with newly drawn drivers."""
        super().reset(seed=seed)
        observation, info = self._one.reset(
            seed=int(self.np_random.integers(2**31)) if seed is None else seed
        )
        return self._first(observation), self._first(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by the steps that an action is held."""
        observation, reward, ended, cut, info = self._one.step(np.asarray(action)[None])
        return self._first(observation), float(reward[0]), bool(ended[0]), bool(cut[0]), self._first(info)

    @staticmethod
    def _first(batch: Any) -> Any:
        return {name: v[0] for name, v in batch.items()} if isinstance(batch, dict) else batch[0]
