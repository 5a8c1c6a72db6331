"""A world without SUMO: holds what it is told. SUMO holds overridden vehicles to 1e-9 m of the same."""

from __future__ import annotations

import numpy as np

from scex_sumo.behaviors.registry import build, parse_models
from scex_sumo.behaviors.sumo_driver import SumoDriver
from scex_sumo.errors import UsageError
from scex_sumo.metrics.rectangles import rectangle_distance
from scex_sumo.rollout import Cast, roll_out
from scex_sumo.scene import BoolArray, FloatArray, SeedScene, States


class PlainWorld:
    """Implements `scex_sumo.rollout.Advances`."""

    def __init__(self, seed: SeedScene) -> None:
        self.states = seed.now.repeat(1)

    def move(self, states: States, mask: BoolArray) -> None:
        self.states = states

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        pass

    def step(self) -> None:
        pass

    def read(self) -> States:
        return self.states


def drive_scene(seed: SeedScene, model: str, *, steps: int, replan: int = 5) -> States:
    """All vehicles of a scene by one model in closed loop: (V, steps + 1), the present first."""
    built = build(parse_models(model)[0])
    if isinstance(built, SumoDriver):
        raise UsageError(f"{model}: SUMO's own drivers need SUMO")
    assert seed.road is not None
    cast = Cast(
        children=np.zeros(1, dtype=np.int64),
        assignment=np.zeros((1, seed.vehicles), dtype=np.int64),
        models=[built],
        names=[model],
        overridden=np.ones(1, dtype=np.bool_),
        route_draw=np.random.default_rng(0).random((1, seed.vehicles)),
        generators=[np.random.default_rng(0)],
    )
    run = roll_out(PlainWorld(seed), seed.road, seed, cast, steps=steps, replan=replan)
    return States.concatenate([seed.now[:, None], run.states[0].swapaxes(0, 1)], axis=1)


def overlaps(states: States, length: FloatArray, width: FloatArray) -> BoolArray:
    """(V, V, T) whether two vehicles' rectangles overlap; never with themselves.

    Args:
        states: (V, T).
        length: (V,) m.
        width: (V,) m.
    """
    count = len(length)
    i, j = np.triu_indices(count, 1)
    reach = np.sqrt(length**2 + width**2) / 2
    dx, dy = states.x[j] - states.x[i], states.y[j] - states.y[i]
    pair, t = np.nonzero(dx**2 + dy**2 <= ((reach[i] + reach[j]) ** 2)[:, None])
    a, b = i[pair], j[pair]
    distance = rectangle_distance(
        dx=dx[pair, t],
        dy=dy[pair, t],
        cos_1=np.cos(states.heading[a, t]),
        sin_1=np.sin(states.heading[a, t]),
        cos_2=np.cos(states.heading[b, t]),
        sin_2=np.sin(states.heading[b, t]),
        length_1=length[a],
        width_1=width[a],
        length_2=length[b],
        width_2=width[b],
    )
    result = np.zeros((count, count, states.shape[1]), dtype=np.bool_)
    hit = distance <= 0
    result[a[hit], b[hit], t[hit]] = True
    return result | result.swapaxes(0, 1)
