"""Gymnasium environments: one vehicle of a seed scene is the agent, drawn models drive the others.

Importing this package registers ``scex_sumo/Seed-v0``. It needs the extra ``gym``.
"""

from typing import Any

from scex_sumo.base.errors import ScexError

try:
    import gymnasium
except ImportError as error:
    raise ScexError(
        f"environments need Gymnasium ({error}); install it: pip install '.[gym]' in the clone"
    ) from error

from scex_sumo.environment.vector_env import SeedEnv, SeedVectorEnv

SEED_ENV = "scex_sumo/Seed-v0"
_vector: Any = SeedVectorEnv

if SEED_ENV not in gymnasium.registry:
    gymnasium.register(SEED_ENV, entry_point=SeedEnv, vector_entry_point=_vector)
