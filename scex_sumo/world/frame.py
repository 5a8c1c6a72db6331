"""Our poses (centre, counter-clockwise from east) and SUMO's (front bumper, clockwise from north)."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.scene import States


def to_sumo(states: States, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Front bumpers and SUMO's angles.

    Args:
        states: (..., V) centres, m and rad.
        length: (V,) m.

    Returns:
        x and y of the front bumper in m, and the angle in degrees, 0 = north, clockwise, in [0, 360).
    """
    x = states.x + 0.5 * length * np.cos(states.heading)
    y = states.y + 0.5 * length * np.sin(states.heading)
    return x, y, np.mod(90.0 - np.degrees(states.heading), 360.0)


def returned(angle: FloatArray) -> FloatArray:
    """SUMO's angle of a vehicle, in degrees, as SUMO gives it back: it keeps radians, 0 = east."""
    kept = np.pi / 2 - angle * np.pi / 180
    back = (np.pi / 2 - kept) * 180 / np.pi
    back = np.where(back >= 360.0, back - 360.0, back)
    degrees: FloatArray = np.where(back < 0.0, back + 360.0, back)
    return degrees


def from_sumo(
    front_x: FloatArray, front_y: FloatArray, angle: FloatArray, speed: FloatArray, length: FloatArray
) -> States:
    """States of vehicles whose front bumper and SUMO angle are known.

    Args:
        front_x: (..., V) m.
        front_y: (..., V) m.
        angle: (..., V) degrees, 0 = north, clockwise.
        speed: (..., V) m/s.
        length: (V,) m.

    Returns:
        (..., V) centres, headings in (-pi, pi].
    """
    heading = np.pi - np.mod(np.pi - np.radians(90.0 - angle), 2.0 * np.pi)
    return States(
        x=front_x - 0.5 * length * np.cos(heading),
        y=front_y - 0.5 * length * np.sin(heading),
        heading=heading,
        speed=speed,
    )
