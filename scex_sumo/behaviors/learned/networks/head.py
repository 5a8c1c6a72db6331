"""Head of the networks: from one vector per vehicle and path to what may happen in the next 3 s."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.learned.networks.architecture import (
    KNOT_S,
    KNOTS,
    OFFSET,
    PRESENT,
    SPEED,
    STRONGEST_ACCELERATION,
    STRONGEST_BRAKING,
    WIDEST_OFFSET_M,
)
from scex_sumo.behaviors.learned.networks.layers import Linear, Mlp, State, relu
from scex_sumo.scene import STEP_S


class Modes(NamedTuple):
    """What may happen in the next 3 s along each path, in M modes; mode 0 is the expected one.

    Attributes:
        logits: (n, M) of the modes.
        acceleration: (n, M, H) m/s², between -9 and 5.
        offset: (n, M, H) wanted distance left of the path, m.
        path_logit: (n,) of the path among the candidates of its vehicle.
        free: (n, M, H, 2) x ahead and y to the left of the present pose, m; None where not asked for.
    """

    logits: FloatArray
    acceleration: FloatArray
    offset: FloatArray
    path_logit: FloatArray
    free: FloatArray | None


class PlanHead:
    """From one vector per pair to modes: knots every 0.5 s, linear between."""

    def __init__(self, state: State, modes: int) -> None:
        self.body, self.modes = Mlp(state, "head.body"), modes
        self.knots, self.choice = Linear(state, "head.knots"), Linear(state, "head.choice")
        self.between = interpolation().astype(np.float64)

    def __call__(self, h: FloatArray, features: FloatArray, *, free: bool = False) -> Modes:
        """Modes of (n, inner) vectors; `features` are the raw ones of the pairs."""
        h = relu(self.body(h))
        choice = self.choice(h)
        knots = self.knots(h).reshape(len(h), self.modes, -1)
        trust = 1 / (1 + np.exp(np.minimum(-choice[:, self.modes + 1 :], 700.0)))  # no overflow
        present = (trust * np.clip(features[:, PRESENT], -4.0, 4.0)).sum(axis=1)
        along, aside = knots[..., :KNOTS], knots[..., KNOTS : 2 * KNOTS - 1]
        return Modes(
            logits=choice[:, : self.modes],
            acceleration=self._acceleration(along, present),
            offset=self._offset(aside, features[:, OFFSET]),
            path_logit=choice[:, self.modes],
            free=self._free(knots[..., 2 * KNOTS - 1 :], features[:, SPEED]) if free else None,
        )

    def _acceleration(self, knots: FloatArray, present: FloatArray) -> FloatArray:
        # What the vehicle does now fades within half a second, so that it need not be learned; but how far
        # its speeds can be trusted is.
        wanted = knots + present[:, None, None] * np.exp(-np.arange(float(KNOTS)))
        most = np.where(wanted > 0, STRONGEST_ACCELERATION, STRONGEST_BRAKING)
        wanted /= most
        bounded = np.tanh(wanted, out=wanted)
        bounded *= most
        acceleration: FloatArray = bounded @ self.between
        return acceleration

    def _offset(self, knots: FloatArray, present: FloatArray) -> FloatArray:
        change = WIDEST_OFFSET_M * np.tanh(knots / WIDEST_OFFSET_M)
        return change @ self.between[1:] + present[:, None, None]  # at the first knot it is 0

    def _free(self, knots: FloatArray, speed: FloatArray) -> FloatArray:
        knots = knots.reshape(*knots.shape[:2], KNOTS, 2)
        ahead = knots[..., 0] @ self.between + speed[:, None, None]
        left = knots[..., 1] @ self.between
        return np.cumsum(np.stack([ahead, left], axis=-1), axis=2) * STEP_S


def interpolation() -> FloatArray:
    """(KNOTS, H) values at the middle of each step from values at the knots; float32, as in training."""
    one, knots = np.float32(1), np.arange(KNOTS, dtype=np.float32)[:, None]
    at = (np.arange(PLAN_STEPS, dtype=np.float32) + one / 2) * np.float32(STEP_S / KNOT_S)
    return np.asarray(np.maximum(one - np.abs(at - knots), 0))
