"""Room to react: needed braking and swerve of a vehicle, and the time left for either.

Each measure looks from now along the vehicle's own line, at given motion of another vehicle. A measure is
undefined where keeping speed and line leads to no contact within the time that the motion covers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, between
from scex_sumo.certainty.response.motion.blocked import Blocked, Lines, blocked_stretches
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.scene import STEP_S

FULL_BRAKING_MPS2: Final = 8.0
"""Deceleration that counts as all of a car's, m/s². Needed braking as a share of it is the BTN (Brännström,
Sjöberg, Coelingh 2008)."""
FULL_SWERVE_MPS2: Final = 7.0
"""Lateral acceleration that counts as all of a car's, m/s². Needed swerve as a share of it is the STN."""

BETWEEN: Final = 5

_MAX_MPS2 = 100.0  # what this does not avoid, nothing does
_BISECTIONS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting:
    """Motion of n vehicles towards n others.

    Attributes:
        lines: (n,) of the vehicles, arc length 0 now.
        speed: (n,) m/s; kept unless a measure changes it.
        length: (n,) m; so ``width``.
        other: (n, T) outlines of the others now, after 0.1 s, ...; half sizes (n, 1).
        room: (n, 2) free space to the left and to the right, m.
    """

    lines: Lines
    speed: FloatArray
    length: FloatArray
    width: FloatArray
    other: Rectangles
    room: FloatArray

    @cached_property
    def time_s(self) -> FloatArray:
        """(K,) times at which contact is looked for, s: `BETWEEN` in a step."""
        return STEP_S / BETWEEN * np.arange(BETWEEN * (self.other.x.shape[1] - 1) + 1)

    @cached_property
    def others(self) -> Rectangles:
        """(n, K) outlines of the others at these times."""
        at = self.time_s / STEP_S
        moved = {name: between(getattr(self.other, name), at) for name in ("x", "y")}
        heading = between(np.unwrap(self.other.heading, axis=1), at)
        return replace(self.other, **moved, heading=heading)

    @cached_property
    def blocked(self) -> Blocked:
        """(n, K) stretches of the lines that the others block."""
        return blocked_stretches(self.lines, np.arange(len(self.speed)), self.length, self.width, self.others)

    @cached_property
    def straight_on(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, K) x, y and heading on the lines with the speed of now."""
        return self.lines.at(np.arange(len(self.speed)), self.speed[:, None] * self.time_s)

    @cached_property
    def collides(self) -> BoolArray:
        """(n,) whether a vehicle that keeps speed and line touches the other one."""
        return self.blocked.touched(self.speed[:, None] * self.time_s)

    def braked(self, deceleration: FloatArray, begin_s: FloatArray) -> BoolArray:
        """Return (n,) whether vehicles touch the other one that brake (n,) from (n,) on to a standstill."""
        braking = np.maximum(self.time_s - begin_s[:, None], 0.0)
        a = deceleration[:, None]
        braking = np.minimum(braking, self.speed[:, None] / np.maximum(a, 1e-12))
        s = self.speed[:, None] * np.minimum(self.time_s, begin_s[:, None])
        return self.blocked.touched(s + self.speed[:, None] * braking - a * braking**2 / 2)

    def swerved(self, acceleration: FloatArray, begin_s: FloatArray, side: int) -> BoolArray:
        """Return (n,) whether vehicles touch the other one that move aside with (n,) from (n,) on.

        They keep speed and heading, and stay within the room. ``side``: 1 to the left, -1 to the right.
        """
        way = acceleration[:, None] * np.maximum(self.time_s - begin_s[:, None], 0.0) ** 2 / 2
        aside = side * np.minimum(way, self.room[:, :1] if side > 0 else self.room[:, 1:])
        x, y, heading = self.straight_on
        own = Rectangles(
            x=x - aside * np.sin(heading),
            y=y + aside * np.cos(heading),
            heading=heading,
            half_length=self.length[:, None] / 2,
            half_width=self.width[:, None] / 2,
        )
        return np.asarray((separation(own, self.others) < 0).any(axis=1))


def needed_braking(meeting: Meeting) -> FloatArray:
    """Compute the least constant deceleration from now on that avoids contact, m/s².

    For an obstacle that stands s ahead it is v² / (2 s).

    Returns:
        (n,) NaN where none is needed, inf where none helps.
    """
    now = np.zeros_like(meeting.speed)
    return _least(meeting, lambda a: meeting.braked(a, now))


def needed_swerve(meeting: Meeting) -> FloatArray:
    """Compute the least constant lateral acceleration, to the easier side, that avoids contact, m/s².

    Returns:
        (n,) as of `needed_braking`; inf if the room is too small, too.
    """
    now = np.zeros_like(meeting.speed)
    sides = [_least(meeting, lambda a, side=side: meeting.swerved(a, now, side)) for side in (1, -1)]  # type: ignore[misc]
    return np.minimum(*sides)


def time_to_brake(meeting: Meeting) -> FloatArray:
    """Compute the latest time from now at which braking with 8 m/s² avoids contact (TTB), s.

    For an obstacle that stands s ahead it is s / v - v / 16. Source: Hillenbrand, Spieker, Kroschel 2006.

    Returns:
        (n,) NaN where there is no contact, -inf where it is too late.
    """
    full = np.full_like(meeting.speed, FULL_BRAKING_MPS2)
    return _latest(meeting, lambda begin: meeting.braked(full, begin))


def time_to_steer(meeting: Meeting) -> FloatArray:
    """Compute the latest time from now at which a swerve with 7 m/s² avoids contact (TTS), s.

    For a vehicle that has to move d aside until time t, it is t - √(2 d / 7). Source and result as of
    `time_to_brake`.
    """
    full = np.full_like(meeting.speed, FULL_SWERVE_MPS2)
    left, right = (
        _latest(meeting, lambda begin, side=side: meeting.swerved(full, begin, side))  # type: ignore[misc]
        for side in (1, -1)
    )
    return np.maximum(left, right)


def time_to_react(meeting: Meeting) -> FloatArray:
    """Compute the time left to brake or to swerve, whichever is longer (TTR), s; as of `time_to_brake`."""
    return np.maximum(time_to_brake(meeting), time_to_steer(meeting))


def _least(meeting: Meeting, touches: Callable[[FloatArray], BoolArray]) -> FloatArray:
    low, high = np.zeros_like(meeting.speed), np.full_like(meeting.speed, _MAX_MPS2)
    hopeless = touches(high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        hit = touches(middle)
        low, high = np.where(hit, middle, low), np.where(hit, high, middle)
    return np.where(meeting.collides, np.where(hopeless, np.inf, high), np.nan)


def _latest(meeting: Meeting, avoids_not: Callable[[FloatArray], BoolArray]) -> FloatArray:
    low = np.zeros_like(meeting.speed)
    high = np.full_like(meeting.speed, meeting.time_s[-1])
    late = avoids_not(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        hit = avoids_not(middle)
        low, high = np.where(hit, low, middle), np.where(hit, middle, high)
    return np.where(meeting.collides, np.where(late, -np.inf, low), np.nan)
