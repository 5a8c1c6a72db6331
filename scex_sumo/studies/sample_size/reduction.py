"""Reduce a seed scene to the vehicles that interact most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.scene import SeedScene

VEHICLES: Final = 5
_LOOK_AHEAD_S = 3.0
_STANDING_MPS = 0.5
_BOTH_STAND_M = 1e3
_OFF_ROAD_M = 1e6  # farther than any vehicle on the road


def choose_vehicles(scene: SeedScene, count: int = VEHICLES) -> IntArray:
    """Choose a group of vehicles around the closest encounter, as ascending indices.

    At constant velocity for 3 s, the two vehicles that come nearest to each other are taken first, then
    always the one that comes nearest to any taken.
    """
    from scex_sumo.roads.matching import off_road

    if not 1 <= count <= scene.vehicles:
        raise UsageError(
            f"{scene.name}: has {scene.vehicles} vehicles, but {count} shall take part; give --vehicles 1 to "
            f"{scene.vehicles}, or a seed scene with more vehicles by --time or --synthetic"
        )
    apart = _nearest_approach(scene)
    stands = scene.now.speed < _STANDING_MPS
    apart[stands[:, None] & stands] += _BOTH_STAND_M
    if scene.road is not None:
        off = off_road(scene.road, scene)
        apart[off, :] += _OFF_ROAD_M
        apart[:, off] += _OFF_ROAD_M
    np.fill_diagonal(apart, np.inf)
    chosen = [int(v) for v in np.unravel_index(np.argmin(apart), apart.shape)][:count]
    while len(chosen) < count:
        nearest = apart[chosen].min(axis=0)
        nearest[chosen] = np.inf
        others = [v for v in range(scene.vehicles) if v not in chosen]
        chosen.append(min(others, key=lambda v: float(nearest[v])))
    return np.sort(np.asarray(chosen, dtype=np.int64))


def _nearest_approach(scene: SeedScene) -> FloatArray:
    now = scene.now
    x, y = now.x, now.y
    vx, vy = now.speed * np.cos(now.heading), now.speed * np.sin(now.heading)
    dx, dy = x[None] - x[:, None], y[None] - y[:, None]
    dvx, dvy = vx[None] - vx[:, None], vy[None] - vy[:, None]
    speed2 = dvx**2 + dvy**2
    when = np.where(speed2 > 0, -(dx * dvx + dy * dvy) / np.where(speed2 > 0, speed2, 1.0), 0.0)
    when = np.clip(when, 0.0, _LOOK_AHEAD_S)
    return np.asarray(np.hypot(dx + dvx * when, dy + dvy * when), dtype=np.float64)


def reduced(scene: SeedScene, vehicles: Sequence[int] | IntArray) -> SeedScene:
    """Return the seed scene with some of its vehicles, by index; other participants stay."""
    kept = np.asarray(vehicles, dtype=np.int64)
    if len(kept) == scene.vehicles:
        return scene
    return scene.reordered(kept.tolist(), name=f"{scene.name}_{len(kept)}v")
