"""Poses: ours (centre, counter-clockwise from east) and SUMO's (front bumper, clockwise from north)."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.scene import States


def to_sumo(states: States, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y (m) and angle (degrees in [0, 360)) in SUMO's frame of states (..., V).

    ``length`` is (V,) in m.
    """
    x = states.x + 0.5 * length * np.cos(states.heading)
    y = states.y + 0.5 * length * np.sin(states.heading)
    return x, y, np.mod(90.0 - np.degrees(states.heading), 360.0)


def angle_read_back(angle: FloatArray) -> FloatArray:
    """Return the angle in degrees as SUMO returns it: SUMO stores radians, 0 = east."""
    stored = np.pi / 2 - angle * np.pi / 180
    back = (np.pi / 2 - stored) * 180 / np.pi
    back = np.where(back >= 360.0, back - 360.0, back)
    degrees: FloatArray = np.where(back < 0.0, back + 360.0, back)
    return degrees


def from_sumo(
    front_x: FloatArray, front_y: FloatArray, angle: FloatArray, speed: FloatArray, length: FloatArray
) -> States:
    """Return states from SUMO's frame, the inverse of `to_sumo`; headings in (-pi, pi]."""
    heading = np.pi - np.mod(np.pi - np.radians(90.0 - angle), 2.0 * np.pi)
    return States(
        x=front_x - 0.5 * length * np.cos(heading),
        y=front_y - 0.5 * length * np.sin(heading),
        heading=heading,
        speed=speed,
    )
