"""From the path of a front bumper, which is what SUMO simulates, to the poses of a car."""

from __future__ import annotations

import numpy as np

from scex_sumo.scene import STEP_S, FloatArray, States

REAR_AXLE_SHARE = 0.8  # rear axle behind the front bumper, in vehicle lengths
SUBSTEPS = 4
EVEN_STEPS = 3  # either side; a mean over 0.7 s, less than a recording's tracker takes


def body_states(front: FloatArray, heading: float, length_m: float) -> States:
    """Poses of a vehicle whose front bumper is led along a path and whose rear axle follows.

    The rear axle of a car rolls along the car's axis: it follows a tractrix of the front. SUMO turns a car as
    if both bumpers lay on the lane, which jumps at the kinks of a polyline and at lane changes.

    Args:
        front: (T, 2) front bumper at each step, m.
        heading: at the first step, rad.
        length_m: of the vehicle.

    Returns:
        (T,) centre, heading and speed along it; the first speed repeats the second.
    """
    front = _even(front)
    lever = REAR_AXLE_SHARE * length_m
    rear = front[0] - lever * np.array([np.cos(heading), np.sin(heading)])
    headings = np.empty(len(front))
    headings[0] = heading
    for k in range(1, len(front)):
        for part in range(1, SUBSTEPS + 1):
            lead = front[k - 1] + (front[k] - front[k - 1]) * part / SUBSTEPS
            axis = lead - rear
            rear = lead - lever * axis / np.hypot(axis[0], axis[1])
        headings[k] = np.arctan2(lead[1] - rear[1], lead[0] - rear[0])
    centre = front - length_m / 2 * np.column_stack([np.cos(headings), np.sin(headings)])
    return States(x=centre[:, 0], y=centre[:, 1], heading=headings, speed=_speeds(centre, headings))


def _even(front: FloatArray) -> FloatArray:
    """The same path at evened-out arc lengths: where lanes meet, steps are centimetres too long or short."""
    step = np.diff(front, axis=0)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    if len(s) < 2:
        return front
    ends = np.arange(1, EVEN_STEPS + 1)
    before, after = s[0] - ends[::-1] * (s[1] - s[0]), s[-1] + ends * (s[-1] - s[-2])
    weights = np.hanning(2 * EVEN_STEPS + 3)[1:-1]
    even = np.convolve(np.concatenate([before, s, after]), weights / weights.sum(), mode="valid")
    even[[0, -1]] = s[[0, -1]]
    moving = np.concatenate([[True], np.diff(s) > 0])
    return np.column_stack([np.interp(even, s[moving], front[moving, axis]) for axis in (0, 1)])


def _speeds(centre: FloatArray, headings: FloatArray) -> FloatArray:
    """Displacement per step along the mean heading of the step; a car does not roll backwards here."""
    if len(centre) < 2:
        return np.zeros(len(centre))
    step = np.diff(centre, axis=0)
    middle = np.unwrap(headings)
    middle = (middle[1:] + middle[:-1]) / 2
    along = (step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)) / STEP_S
    return np.asarray(np.maximum(np.concatenate([along[:1], along]), 0.0))
