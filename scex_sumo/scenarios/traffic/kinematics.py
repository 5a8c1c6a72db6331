"""Kinematics of a car: its poses from the path of its front bumper, which is what SUMO simulates."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.scene import STEP_S, States

REAR_AXLE_SHARE = 0.8  # rear axle behind the front bumper, in vehicle lengths
SUBSTEPS = 4
EVEN_STEPS = 3  # on either side
PATH_STEP_M, PATH_STEPS = 0.25, 8  # 2 m on either side


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
    """The same drive without the map's kinks.

    Where lanes meet, steps are centimetres too long or short, and lanes are polylines: arc length is averaged
    over time and the path over arc length, both over less than a recording's tracker does.
    """
    s = arc_lengths(front)
    moving = np.concatenate([[True], np.diff(s) > 0])
    if moving.sum() < 2:
        return front
    even = _averaged(s, EVEN_STEPS)
    fine = np.linspace(0.0, s[-1], max(2, int(np.ceil(s[-1] / PATH_STEP_M)) + 1))
    columns = []
    for axis in (0, 1):
        smooth = _averaged(np.interp(fine, s[moving], front[moving, axis]), PATH_STEPS)
        columns.append(np.interp(even, fine, smooth))
    return np.column_stack(columns)


def _averaged(values: FloatArray, reach: int) -> FloatArray:
    """Weighted mean over ``reach`` neighbours on either side; the ends stay where they are."""
    ends = np.arange(1, reach + 1)
    before = values[0] - ends[::-1] * (values[1] - values[0])
    after = values[-1] + ends * (values[-1] - values[-2])
    weights = np.hanning(2 * reach + 3)[1:-1]
    mean = np.convolve(np.concatenate([before, values, after]), weights / weights.sum(), mode="valid")
    mean[[0, -1]] = values[[0, -1]]
    return np.asarray(mean)


def _speeds(centre: FloatArray, headings: FloatArray) -> FloatArray:
    """Displacement per step along the mean heading of the step; a car does not roll backwards here."""
    if len(centre) < 2:
        return np.zeros(len(centre))
    step = np.diff(centre, axis=0)
    middle = np.unwrap(headings)
    middle = (middle[1:] + middle[:-1]) / 2
    along = (step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)) / STEP_S
    return np.asarray(np.maximum(np.concatenate([along[:1], along]), 0.0))
