"""What rules see of a moment: lights, and places of vehicles on their paths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import SeedPaths, path_positions
from scex_sumo.road import Rules
from scex_sumo.scene import SceneHistory, VehicleIndex

STANDS_MPS = 0.5
GAIN_STEPS = 3

GREEN, YELLOW, RED = "Gg", "yY", "rRu"


@dataclass(frozen=True, eq=False)
class Lit:
    """Lights now: (1 or C, G + 1), of all futures or of each; the last one is that of passages without."""

    red: BoolArray
    yellow: BoolArray
    green: BoolArray
    free: BoolArray  # green with priority
    stop: BoolArray
    ready: BoolArray  # red and yellow: green follows
    since_s: FloatArray  # how long it has been shown, s

    @classmethod
    def at(cls, rules: Rules, time_s: float) -> Lit:
        """Return the lights at a time since the seed moment."""
        shown = [*(signal.at(time_s) for signal in rules.signals), ("", 0.0)]
        letters = np.array([[letter for letter, _ in shown]])
        kinds = RED, YELLOW, GREEN, "G", "s", "u"
        red, yellow, green, free, stop, ready = (np.isin(letters, [*kind]) for kind in kinds)
        return cls(red, yellow, green, free, stop, ready, np.array([[since for _, since in shown]]))

    def of(self, name: str, future: IntArray, signal: IntArray) -> Any:
        """Return what signals (m,) show in futures (m,)."""
        values = getattr(self, name)
        return values[future % len(values), signal]


@dataclass(frozen=True, kw_only=True, eq=False)
class Traffic:
    """Places of all vehicles on their paths: (C, V) path, centre, front and rear, m, and speed, m/s."""

    row: IntArray
    arc_length: FloatArray
    front: FloatArray
    rear: FloatArray
    speed: FloatArray
    slowest: FloatArray  # (C, V) speed in the last second, m/s
    gained: FloatArray  # (C, V) speed in the last three steps, m/s


def traffic_on(history: SceneHistory, paths: SeedPaths, row: IntArray) -> Traffic:
    """Return the places of all vehicles on paths (C, V)."""
    now = history.now
    s, _, _ = path_positions(history, VehicleIndex.everyone(history), paths, row.ravel())
    s, half = s.reshape(row.shape), history.scene.length / 2
    return Traffic(
        row=row,
        arc_length=s,
        front=s + half,
        rear=s - half,
        speed=np.maximum(now.speed, 0.0),
        slowest=history.states.speed.min(axis=2),
        gained=now.speed - history.states.speed[:, :, -1 - GAIN_STEPS],
    )


@owner_cache
def straight_traffic(history: SceneHistory, paths: SeedPaths) -> Traffic:
    """Return the places of all vehicles on their straightest paths."""
    row = np.broadcast_to(paths.first + paths.straight, history.now.shape)
    return traffic_on(history, paths, row)
