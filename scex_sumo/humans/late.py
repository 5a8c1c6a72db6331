"""Late responses: drivers that have let hard braking become necessary, because they have not seen what comes.

The largest need of an encounter is exponentially distributed among drivers that look, and with a far larger
scale among the few that do not. One that needs much at the seed moment and does not brake probably is one of
these. It responds after a lognormal time, as to a surprise, and drives on as it does until then.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.draws import normal_quantiles, uniforms
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.motion import Accelerate
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.conflicts.braking import needed_braking, recent_acceleration
from scex_sumo.conflicts.driven import HORIZON_S, DrivenPaths
from scex_sumo.conflicts.shared import shared_stretches
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene, VehicleIndex

# Scale of the largest need by the follower's speed: m/s, and m/s² (benchmarks/fit_conflicts.py)
SCALES: Final = ((1.5, 4.5, 7.5, 11.0), (0.25, 0.33, 0.5, 0.6))
UNSEEN_MPS2: Final = 3.0  # the same among drivers that do not look, about
UNSEEN: Final = 2.7e-4  # their share: contacts are then as frequent as published (docs/decision.md)
BRAKES_MPS2: Final = -1.0  # mean acceleration over half a second below which a driver brakes
MOST_NEED_MPS2: Final = 8.0  # from it not the driver is taken to be wrong, but its expected way
RESPONSE_S: Final = 1.25  # median time until one brakes for what one did not expect (Green 2000)
SPREAD: Final = 0.35  # deviation of its logarithm, chosen within the ranges of Green 2000
_SALT = 80_000  # of the draws
_POINTS = 32  # of a path ahead
_BEFORE = 4  # steps for which it has been necessary


def still_unaware(
    history: SceneHistory, paths: SeedPaths, vehicles: VehicleIndex, spread: float
) -> BoolArray:
    """Return (n,) whether drivers drive on as they do, because they have not responded yet.

    ``spread``: on the variation between drivers.
    """
    need = needs(history.scene, paths)[vehicles.vehicle]
    draws = uniforms(history.route_draw[vehicles.future, vehicles.vehicle], 2, _SALT)
    response_s = RESPONSE_S * np.exp(SPREAD * min(spread, 1.0) * normal_quantiles(draws[:, 0]))
    looks = draws[:, 1] >= share_unseen(need, history.scene.now.speed[vehicles.vehicle])
    return np.asarray(~looks & (history.step * STEP_S < response_s))


def share_unseen(need: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the share of drivers that have not seen what they need to brake for.

    ``need``: of braking, m/s²; from `MOST_NEED_MPS2` on the share is 0; ``speed``: m/s.
    """
    looking = (1 - UNSEEN) * np.exp(-need / np.interp(speed, *SCALES))
    unseen = UNSEEN * np.exp(-need / UNSEEN_MPS2)
    return np.where((need > 0) & (need < MOST_NEED_MPS2), unseen / (looking + unseen), 0.0)


def unchanged(accelerate: Accelerate, rows: BoolArray) -> Accelerate:
    """Return the same acceleration, but none of some vehicles (n,)."""

    def held(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        return np.where(rows, 0.0, accelerate(step, v, travelled, s))

    return held if rows.any() else accelerate


@owner_cache
def needs(scene: SeedScene, paths: SeedPaths) -> FloatArray:
    """Return (V,) braking that vehicles have needed for 0.4 s, m/s²; 0 for those that brake already."""
    past, now = scene.history, scene.now
    row = paths.first + paths.straight
    s, _, _ = paths.foot_points(row, now.x, now.y, np.full(scene.vehicles, BEHIND_M))
    reach = np.maximum(HORIZON_S * now.speed, 1.0)[:, None]
    at = (s[:, None] + reach * np.linspace(0.05, 1.0, _POINTS)) / DS_M
    index = row[:, None] * paths.samples + np.clip(np.rint(at), 0, paths.samples - 1).astype(np.int64)
    ways = DrivenPaths.of(past, scene.length, scene.width, paths.table[index, :2].transpose(2, 0, 1))
    one, two = np.triu_indices(scene.vehicles, 1)
    acceleration = recent_acceleration(past.speed)
    steps, need = np.array([HISTORY_STEPS - _BEFORE, HISTORY_STEPS]), np.zeros(scene.vehicles)
    for side in shared_stretches(ways, one, two):
        np.maximum.at(need, side.own, needed_braking(ways, side, acceleration, steps).min(axis=1))
    return np.where(acceleration[:, -1] > BRAKES_MPS2, need, 0.0)
