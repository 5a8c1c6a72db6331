"""Vector environment of Stable-Baselines3: an episode that ends begins again within the same step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import MissingExtraError, UsageError
from scex_sumo.environment.agent import Observation
from scex_sumo.environment.vector_env import SeedVectorEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise MissingExtraError(
        f"this environment needs Stable-Baselines3 ({error}); pip install stable-baselines3"
    ) from error


class StableBaselinesEnv(VecEnv):  # type: ignore[misc]
    """`SeedVectorEnv` for algorithms of Stable-Baselines3, with the same arguments; observations are flat.

    ``infos`` of an environment that has ended hold ``terminal_observation`` and ``TimeLimit.truncated``.
    """

    def __init__(self, num_envs: int = 385, **arguments: Any) -> None:
        if arguments.get("observation", "flat") != "flat":
            raise UsageError("observation: Stable-Baselines3 flattens it itself; leave it out")
        self._envs = SeedVectorEnv(num_envs, **arguments)
        self._actions = np.zeros(self._envs.action_space.shape or ())
        super().__init__(num_envs, self._envs.single_observation_space, self._envs.single_action_space)

    def reset(self) -> Observation:
        """Put all environments to the seed scene, with newly drawn drivers."""
        seed = self._seeds[0]
        self._reset_seeds()
        self._reset_options()
        return self._envs.reset(seed=seed)[0]

    def step_async(self, actions: FloatArray) -> None:
        """Keep the (N, ...) actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Observation, FloatArray, BoolArray, list[dict[str, Any]]]:
        """Advance all environments; those that end begin again now."""
        seen, reward, terminated, truncated, _ = self._envs.step(self._actions)
        assert isinstance(seen, np.ndarray)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(done).tolist():
            infos[env] = {"terminal_observation": seen[env], "TimeLimit.truncated": bool(truncated[env])}
        return self._envs.begin_again(done) if done.any() else seen, reward, done, infos

    def close(self) -> None:
        """Release the environments."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute once for each environment; None if they have none of this name."""
        return [getattr(self._envs, attr_name, None)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute, which all environments share."""
        setattr(self._envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **options: Any) -> list[Any]:
        """Call a method, which all environments share, once; return its value for each."""
        return [getattr(self._envs, method_name)(*args, **options)] * len(self._chosen(indices))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each: single environments have no wrappers."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: Any) -> Sequence[int]:
        chosen: Sequence[int] = list(self._get_indices(indices))
        return chosen
