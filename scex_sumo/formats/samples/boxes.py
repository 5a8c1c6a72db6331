"""Recorded boxes of road users as tracks: names, types, sizes and missing velocities."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.tracks.check import MAX_VALUES, refuse_values
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackTable
from scex_sumo.formats.samples.build import track_table
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S

SIZES = {
    "car": (4.6, 1.9),
    "bus": (11.5, 2.6),
    "truck": (8.0, 2.5),
    "motorcycle": (2.2, 0.8),
    "bicycle": (1.8, 0.7),
    "pedestrian": (0.6, 0.6),
}
"""Length and width in m of road users without a recorded size."""
SWAPPED = 1.5  # a vehicle so many times as wide as long has its sides swapped
MAX_NAME = 200  # letters of a track's name: all names together are one array of the longest
FILLED = ("vx", "vy", "length", "width")  # where they are missing


def box_table(
    path: Path, names: Sequence[str], kinds: Mapping[str, str], values: FloatArray, *, ego: str = ""
) -> TrackTable:
    """Build a recording from boxes in any order.

    Args:
        names: (N,) track of each box.
        kinds: type of each track; those that `SIZES` does not have are left out.
        values: (N, 8) as `FLOAT_COLUMNS`; nan for unknown velocities and sizes.
        ego: name of the recording vehicle.

    Returns:
        The recording, its time from 0, with a note for each guess.

    Raises:
        TrackError: a value is missing or out of range, or no vehicle is left.
    """
    _check(path, names, values)
    kept = np.array([kinds.get(name, "") in SIZES for name in names], bool)
    left_out = Counter(kind for kind in kinds.values() if kind not in SIZES)
    dropped = ", ".join(f"{number} {kind or 'of no type'}" for kind, number in sorted(left_out.items()))
    notes = [f"objects that are no road users, left out: {dropped}"] if dropped else []
    labels, track = np.unique(np.asarray(names, str)[kept], return_inverse=True)
    values = values[kept]
    if not any(kinds[str(label)] in MOTOR_TYPES for label in labels):
        raise TrackError(f"{path}: no vehicle in it; name a recording with traffic")
    order = np.lexsort((values[:, 0], track))
    track, values = track[order].astype(np.int64), values[order]
    twice = np.append(False, (np.diff(track) == 0) & (np.diff(values[:, 0]) <= 0.0))
    if twice.any():
        notes.append(f"{int(twice.sum())} boxes of one track and time left out")
        track, values = track[~twice], values[~twice]
    words = [kinds[str(label)] for label in labels]
    motors = np.array([word in MOTOR_TYPES for word in words], bool)
    values[:, 0] = np.rint(values[:, 0] - values[:, 0].min())  # whole milliseconds
    notes += _fill_velocities(track, values)
    notes += _fill_sizes(track, values, words, motors[track])
    numbers, named = _numbers(labels.tolist(), motors.tolist())
    notes += named
    if ego and ego in kinds:
        notes.append(f"the recording vehicle {ego} is vehicle {numbers[labels.tolist().index(ego)]}")
    steps = np.diff(values[:, 0])[np.diff(track) == 0]
    step_s = float(np.median(steps)) / 1000.0 if len(steps) else STEP_S
    columns = dict(zip(FLOAT_COLUMNS, values.T.copy(), strict=True))
    columns["psi_rad"] = np.asarray(wrap(columns["psi_rad"]))
    said = tuple(notes)
    return track_table(path, motors[track], track, numbers, words, step_s=step_s, notes=said, **columns)


def yaw_of(qw: Any, qx: Any, qy: Any, qz: Any) -> Any:
    """Return the heading of a quaternion, rad; nan if a part is infinite."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))


def _check(path: Path, names: Sequence[str], values: FloatArray) -> None:
    if (longest := max(set(names), key=len, default="")) and len(longest) > MAX_NAME:
        raise TrackError(f"{path}: a track's name has {len(longest)} letters; fetch the file again")
    columns = dict(zip(FLOAT_COLUMNS, values.T, strict=True))
    refuse_values(path, columns, MAX_VALUES, lambda row: f"track {names[row]:.24}", optional=FILLED)
    if not len(values):
        raise TrackError(f"{path}: no box in it; name a recording with traffic")


def _fill_velocities(track: IntArray, values: FloatArray) -> list[str]:
    missing = np.isnan(values[:, 3:5]).any(axis=1)
    # Some writers leave all velocities at zero; a track that stands gets zero anyway.
    missing |= ~np.isin(track, np.unique(track[(values[:, 3:5] != 0.0).any(axis=1)]))
    for number in np.unique(track[missing]):
        rows = np.flatnonzero(track == number)
        slope: FloatArray = np.zeros((1, 2))
        if len(rows) > 1:
            slope = np.gradient(values[rows, 1:3], values[rows, 0] / 1000.0, axis=0)
        values[rows, 3:5] = np.where(missing[rows, None], slope, values[rows, 3:5])
    return ["velocities are not recorded: computed from positions"] if missing.all() else []


def _fill_sizes(track: IntArray, values: FloatArray, words: list[str], motor: BoolArray) -> list[str]:
    notes = []
    unknown = ~(values[:, 6:8] > 0.0)
    usual = np.array([SIZES[word] for word in words])[track]
    values[:, 6:8] = np.where(unknown, usual, values[:, 6:8])
    if unknown.any():
        used = sorted({words[k] for k in np.unique(track[unknown.any(axis=1)])})
        sizes = ", ".join(f"{word} {SIZES[word][0]:g} m x {SIZES[word][1]:g} m" for word in used)
        notes.append(f"sizes are not recorded: {sizes}")
    swapped = motor & (values[:, 7] > SWAPPED * values[:, 6])
    values[swapped, 6:8] = values[swapped, 7:5:-1]
    if swapped.any():
        vehicles = len(np.unique(track[swapped]))
        notes.append(f"length and width of {vehicles} vehicles are swapped in the file: swapped back")
    return notes


def _numbers(labels: list[str], motor: list[bool]) -> tuple[list[str], list[str]]:
    numbers = [str(int(label)) if re.fullmatch(r"\d{1,18}", label) else "" for label in labels]
    free = count(max((int(number) for number in numbers if number), default=0) + 1)
    named = sum(vehicle and not number for number, vehicle in zip(numbers, motor, strict=True))
    for k, (label, vehicle) in enumerate(zip(labels, motor, strict=True)):
        numbers[k] = numbers[k] or (str(next(free)) if vehicle else label)
    return numbers, ["vehicles are numbered in the order of their names"] if named > 1 else []
