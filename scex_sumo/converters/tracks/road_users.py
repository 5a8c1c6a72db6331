"""Types and usual sizes of road users."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.scene import HISTORY_STEPS, Obstacles

RUNNING_MPS: Final = 3.0
"""Mean speed above which one who walks or rides, as ``pedestrian/bicycle``, rides."""

PEOPLE: Final = ("pedestrian", "bicycle")
"""Road users that may take part in a scene, in the words of `road_user`."""

MOTOR_TYPES = frozenset(
    (
        *("car", "truck", "bus", "van", "motorcycle", "motorbike", "trailer", "taxi", "vehicle", "truck_bus"),
        *("ambulance", "automobile", "coach", "hgv", "lorry", "minibus", "pickup", "police", "suv"),
    )
)
"""Types that become vehicles of a seed scene. An unknown type does so too if it is as large as a vehicle and
drives; all others are obstacles."""

OTHER_TYPES = frozenset(
    (
        *("animal", "bicycle", "bicyclist", "bike", "cyclist", "escooter", "human", "pedestrian"),
        *(
            "pedestrian/bicycle",
            "parked",
            "person",
            "replayed",
            "rider",
            "scooter",
            "train",
            "tram",
            "wheelchair",
        ),
    )
)
"""Types that never become vehicles, however large and fast."""

OBSTACLE_SIZES = {"pedestrian": (0.6, 0.6), "bicycle": (1.8, 0.7), "tram": (30.0, 2.6)}
"""Length and width in m if the recording gives none; all other types get those of a bicycle."""

MIN_LENGTH_M, MIN_WIDTH_M, DRIVEN_MPS = 2.5, 1.2, 4.0
"""Least size of a vehicle of an unknown type, and a speed that one of its type reaches."""

_WORDS = (
    ("motor", "motorcycle"),
    *((word, "bicycle") for word in ("bicycl", "cyclist", "bike", "scooter", "rider")),
    *((word, "pedestrian") for word in ("pedestrian", "person", "human", "wheelchair")),
    *((word, "bus") for word in ("bus", "coach")),
    *((word, "truck") for word in ("truck", "lorry", "hgv", "trailer")),
    *((word, "tram") for word in ("tram", "train")),
    ("van", "van"),
)


def road_user(kind: str) -> str:
    """Return a type in the words of other programs, e.g. car, truck, bicycle; car if unknown."""
    return next((user for word, user in _WORDS if word in kind), "car")


def fill_sizes(columns: dict[str, FloatArray], track: IntArray, kinds: Sequence[str]) -> None:
    """Set lengths and widths that are not positive, or nan, to the usual ones of a track's type, in place."""
    usual = np.array([OBSTACLE_SIZES.get(kind, OBSTACLE_SIZES["bicycle"]) for kind in kinds])
    for k, name in enumerate(("length", "width")):
        columns[name] = np.where(columns[name] > 0.0, columns[name], usual.reshape(-1, 2)[track, k])


def person_kind(kind: str, speed: FloatArray) -> str:
    """Return the type of a road user; its speeds (T,), m/s, decide on ``pedestrian/bicycle``."""
    if "pedestrian" in kind and "bicycle" in kind:
        return PEOPLE[int(np.mean(speed) > RUNNING_MPS)]
    return kind


@owner_cache
def obstacle_kinds(others: Obstacles) -> tuple[str, ...]:
    """Return the types (O,) of obstacles; the last second decides on ``pedestrian/bicycle``."""
    past = others.states.speed[:, : HISTORY_STEPS + 1]
    return tuple(person_kind(kind, speed) for kind, speed in zip(others.types, past, strict=True))


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
