"""Kinematics of a car: poses from the path of its front bumper, which SUMO simulates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.scene import STEP_S, States

REAR_AXLE_SHARE = 0.8  # behind the front bumper, in lengths
SUBSTEPS = 4
EVEN_STEPS = 3  # on either side
PATH_STEP_M, PATH_STEPS = 0.25, 8  # 2 m on either side


def body_states(
    fronts: Sequence[FloatArray], headings: Sequence[float], lengths_m: Sequence[float]
) -> list[States]:
    """Return states of vehicles whose front bumper follows a path.

    The rear axle follows a tractrix of the front. SUMO puts both bumpers on the lane, which jumps at kinks
    and lane changes.

    Args:
        fronts: (T, 2) front bumper of each vehicle, m; T differs between vehicles.
        headings: at the first step, rad.

    Returns:
        (T,) states of each vehicle; the first speed repeats the second.
    """
    fronts = [_even(front) for front in fronts]
    steps = max(map(len, fronts), default=0)
    # Vehicles with shorter paths stand at the end of theirs.
    path = np.stack([np.pad(front, ((0, steps - len(front)), (0, 0)), "edge") for front in fronts], axis=1)
    angles = np.empty(path.shape[:2])
    angles[0] = headings
    lever = REAR_AXLE_SHARE * np.array(lengths_m)[:, None]
    rear = path[0] - lever * np.column_stack([np.cos(angles[0]), np.sin(angles[0])])
    for k in range(1, steps):
        for part in range(1, SUBSTEPS + 1):
            lead = path[k - 1] + (path[k] - path[k - 1]) * part / SUBSTEPS
            axis = lead - rear
            rear = lead - lever * axis / np.hypot(axis[:, 0], axis[:, 1])[:, None]
        angles[k] = np.arctan2(lead[:, 1] - rear[:, 1], lead[:, 0] - rear[:, 0])
    states = []
    for front, angle, length_m in zip(fronts, angles.T, lengths_m, strict=True):
        heading = angle[: len(front)].copy()
        centre = front - length_m / 2 * np.column_stack([np.cos(heading), np.sin(heading)])
        states.append(States(x=centre[:, 0], y=centre[:, 1], heading=heading, speed=_speeds(centre, heading)))
    return states


def _even(front: FloatArray) -> FloatArray:
    """Smooth a drive over the map's kinks, by less than a tracker does."""
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
    ends = np.arange(1, reach + 1)
    before = values[0] - ends[::-1] * (values[1] - values[0])
    after = values[-1] + ends * (values[-1] - values[-2])
    weights = np.hanning(2 * reach + 3)[1:-1]
    mean = np.convolve(np.concatenate([before, values, after]), weights / weights.sum(), mode="valid")
    mean[[0, -1]] = values[[0, -1]]
    return np.asarray(mean)


def _speeds(centre: FloatArray, headings: FloatArray) -> FloatArray:
    if len(centre) < 2:
        return np.zeros(len(centre))
    step = np.diff(centre, axis=0)
    middle = np.unwrap(headings)
    middle = (middle[1:] + middle[:-1]) / 2
    along = (step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)) / STEP_S
    return np.asarray(np.maximum(np.concatenate([along[:1], along]), 0.0))
