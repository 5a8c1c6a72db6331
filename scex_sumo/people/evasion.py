"""Evasion: people do not walk into a vehicle, or stay in its way, if they see that it touches them soon.

A person expects each vehicle to keep its velocity for `LOOK_S`. If its own plan touches one, the person turns
a little, stops, goes aside, back, or hurries: the first that does not touch, else the one that touches last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.scene import STEP_S, Plan, SceneHistory, VehicleIndex

LOOK_S: Final = 1.5
STEPS: Final = round(LOOK_S / STEP_S)
EVASIONS: Final = (
    *((turn, 0.01) for turn in (0.35, -0.35, 0.8, -0.8)),
    (0.0, 0.0),
    *((turn, 1.0) for turn in (np.pi / 2, -np.pi / 2, np.pi)),
    (0.0, 2.0),
)
"""Turn, rad, and least speed, m/s, of each; speed 0 stops. Chosen on training parts: error, contacts."""

Alternative = Callable[[IntArray], Plan]
"""Returns the plans of some of n people, given by index."""


def evaded(plan: Plan, history: SceneHistory, who: VehicleIndex, others: Sequence[Alternative]) -> Plan:
    """Return the plan of n people, or another one for those that would touch a vehicle."""
    until = first_touch(plan, history, who)
    if not (rows := np.flatnonzero(until <= STEPS)).size:
        return plan
    for other in others:
        tried = other(rows)
        later = first_touch(tried, history, who[rows])
        better = later > until[rows]
        plan.assign(rows[better], tried[better])
        until[rows[better]] = later[better]
        if not (rows := rows[until[rows] <= STEPS]).size:
            break
    return plan


def first_touch(plan: Plan, history: SceneHistory, who: VehicleIndex) -> FloatArray:
    """Return the steps (n,) after which people touch a vehicle; inf where they do not within `LOOK_S`.

    Who touches one now does not count.
    """
    scene = history.scene
    vehicles = np.arange(scene.vehicles) if scene.people is None else np.flatnonzero(~scene.people)
    now, me = history.now[:, vehicles][who.future], history.now[who.future, who.vehicle]
    size = (scene.length[who.vehicle] + scene.width[who.vehicle])[:, None] / 4
    half = scene.length[vehicles] / 2 + size, scene.width[vehicles] / 2 + size
    cos, sin = np.cos(now.heading), np.sin(now.heading)

    def touches(x: FloatArray, y: FloatArray, way: FloatArray) -> BoolArray:
        dx, dy = x[:, None] - now.x, y[:, None] - now.y
        ahead, aside = cos * dx + sin * dy - way, cos * dy - sin * dx
        return np.asarray((np.abs(ahead) < half[0]) & (np.abs(aside) < half[1]))

    apart = ~touches(me.x, me.y, np.zeros_like(now.x))
    until = np.full(len(who), np.inf)
    for step in reversed(range(STEPS)):
        hit = touches(plan.x[:, step], plan.y[:, step], now.speed * ((step + 1) * STEP_S)) & apart
        until[hit.any(axis=1)] = step + 1
    return until
