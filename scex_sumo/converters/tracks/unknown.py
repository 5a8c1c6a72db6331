"""Vehicles among tracks of an unknown type, told by their size and speed."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES, OTHER_TYPES

MIN_LENGTH_M, MIN_WIDTH_M, DRIVEN_MPS = 2.5, 1.2, 4.0
"""Least size of a vehicle of an unknown type, and a speed that one of its type reaches."""


def with_unknown_vehicles(
    types: list[str],
    kind: IntArray,
    track: IntArray,
    length: FloatArray,
    width: FloatArray,
    speed: FloatArray,
) -> tuple[IntArray, tuple[str, ...]]:
    """Set the type of large tracks to ``vehicle`` if it is unknown and some of them drive.

    Args:
        types: the names; ``vehicle`` is added if needed.
        kind: (K,) index of each track's type, also returned; with a phrase for each type that has vehicles.
        length: (N,) m, nan if not known; ``width`` too.
    """
    unknown = np.array([name not in MOTOR_TYPES and name not in OTHER_TYPES for name in types], bool)
    if not unknown[kind].any():
        return kind, ()
    large: BoolArray = np.ones(len(kind), bool)
    np.logical_and.at(large, track, (length >= MIN_LENGTH_M) & (width >= MIN_WIDTH_M))
    fastest = np.zeros(len(kind))
    np.maximum.at(fastest, track, speed)
    kind, notes = kind.copy(), []
    for number in np.unique(kind[unknown[kind]]).tolist():
        chosen = (kind == number) & large
        if not (fastest[chosen] >= DRIVEN_MPS).any():
            continue
        if "vehicle" not in types:
            types.append("vehicle")
        kind[chosen] = types.index("vehicle")
        notes.append(
            f"unknown type {types[number][:24]!r}: {int(chosen.sum())} tracks are as large as vehicles and "
            "drive: taken for vehicles"
        )
    return kind, tuple(notes)
