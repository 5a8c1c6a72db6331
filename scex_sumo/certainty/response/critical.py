"""Critical response R*: the latest response of a vehicle to an action of another one without contact.

The responder moves as expected until a response time after the action shows. Then it brakes with a jerk of
12.65 m/s³ up to a deceleration A. It does not steer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.certainty.response.motion.actions import LEVELS, TIME_S, Cases

JERK_MPS3: Final = 12.65
"""Of a braking response (UN Regulation 157)."""
DECELERATIONS: Final = (4.0, 6.0, 7.6)
"""A of a response, m/s²; the last one is that of the careful and competent driver, 0.774 g."""
TYPICAL: Final = 1
"""Index of the deceleration whose R* stands for all."""
CAREFUL_S: Final = 1.15
"""Response time of the careful and competent driver: 0.4 s perception, 0.75 s delay (UN Regulation 157)."""
LATEST_S: Final = 6.4
"""Latest response that is tried; one that comes later is none."""
HARD_MPS: Final = 4.0
"""Closing speed of an impact that changes the speed of two equal vehicles by 2 m/s."""

_BISECTIONS = 8  # of `LATEST_S`: to 0.025 s


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Motion of responders in m cases.

    Attributes:
        s: (m, T) arc length, m.
        speed: (m, T) m/s.
    """

    cases: Cases
    s: FloatArray
    speed: FloatArray

    @property
    def gap(self) -> FloatArray:
        """(m, T) way until contact, m; inf where the initiator blocks nothing ahead."""
        blocked = self.cases.blocked
        return np.where(self.s < blocked.leave, blocked.enter - self.s, np.inf)

    def impact(self) -> tuple[BoolArray, FloatArray]:
        """Return (m,) whether there is contact, and the relative speed at it, m/s."""
        cases = self.cases
        hit = cases.blocked.touches(self.s)
        rows, first = np.arange(len(hit)), np.argmax(hit, axis=1)
        at = self.s[rows, first]
        j = cases.pairs.responder[cases.pair]
        heading = cases.pairs.expected.lines.at(j, at)[2]
        own = self.speed[rows, np.maximum(first - 1, 0)]
        other = cases.velocity[rows, first]
        dx, dy = own * np.cos(heading) - other[:, 0], own * np.sin(heading) - other[:, 1]
        return np.asarray(hit.any(axis=1)), np.hypot(dx, dy)


Happens = Callable[[Motion], BoolArray]
"""Whether an event (m,) happens in a motion."""


def contact(motion: Motion) -> BoolArray:
    """Return whether both vehicles touch."""
    return motion.cases.blocked.touched(motion.s)


def hard_contact(motion: Motion) -> BoolArray:
    """Return whether both vehicles touch at a relative speed of `HARD_MPS` or more."""
    hit, speed = motion.impact()
    return hit & (speed >= HARD_MPS)


def responded(cases: Cases, response_s: FloatArray, deceleration: float) -> Motion:
    """Return the motion of responders that respond (m,) seconds after the onset of the action."""
    expected, j = cases.pairs.expected, cases.pairs.responder[cases.pair]
    start = np.minimum(cases.onset_s + response_s, TIME_S[-1] + 1.0)[:, None]
    state = expected.at(j, start)
    before, usual = expected.s[j], expected.speed[j]
    a0 = np.minimum(state["acceleration"], 0.0)
    most = np.maximum(deceleration, -a0)
    tau = np.maximum(TIME_S - start, 0.0)
    ramp = (most + a0) / JERK_MPS3
    v0 = state["speed"]
    v1 = v0 + a0 * ramp - JERK_MPS3 * ramp**2 / 2
    s1 = v0 * ramp + a0 * ramp**2 / 2 - JERK_MPS3 * ramp**3 / 6
    in_ramp = (a0 + np.sqrt(a0**2 + 2 * JERK_MPS3 * v0)) / JERK_MPS3
    stop = np.where(v1 <= 0, in_ramp, ramp + np.maximum(v1, 0.0) / most)
    tau = np.minimum(tau, stop)
    later = np.maximum(tau - ramp, 0.0)
    early = np.minimum(tau, ramp)
    way = v0 * early + a0 * early**2 / 2 - JERK_MPS3 * early**3 / 6 + v1 * later - most * later**2 / 2
    way = np.where(tau > ramp, s1 + v1 * later - most * later**2 / 2, way)
    speed = np.where(tau > ramp, v1 - most * later, v0 + a0 * early - JERK_MPS3 * early**2 / 2)
    after = start < TIME_S
    return Motion(
        cases=cases,
        s=np.where(after, np.minimum(state["s"] + way, before), before),
        speed=np.where(after, np.clip(speed, 0.0, usual), usual),
    )


def critical_response(
    cases: Cases, happens: Happens = contact, decelerations: tuple[float, ...] = DECELERATIONS
) -> FloatArray:
    """Return R* (m, A): the largest response time without the event, for each deceleration, s.

    To 0.05 s; -inf where the event happens at once, inf where it never does.
    """
    latest = np.full((len(cases), len(decelerations)), np.inf)
    never = np.full(len(cases), 2 * TIME_S[-1])
    rows = np.flatnonzero(happens(responded(cases, never, decelerations[0])))
    part = cases.take(rows)
    for column, deceleration in enumerate(decelerations):
        low, high = np.zeros(len(rows)), np.full(len(rows), LATEST_S)
        hopeless = happens(responded(part, low, deceleration))
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            hit = happens(responded(part, middle, deceleration))
            low, high = np.where(hit, low, middle), np.where(hit, middle, high)
        latest[rows, column] = np.where(hopeless, -np.inf, low)
    return latest


def by_action(values: FloatArray) -> FloatArray:
    """Return values (m, ...) by pair's action and level, (m / 10, 10, ...)."""
    return values.reshape(len(values) // LEVELS, LEVELS, *values.shape[1:])
