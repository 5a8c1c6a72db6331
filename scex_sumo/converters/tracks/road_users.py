"""Types and usual sizes of road users."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.scene import HISTORY_STEPS, Obstacles

RUNNING_MPS: Final = 3.0
"""Mean speed above which one who walks or rides, as ``pedestrian/bicycle``, rides."""

PEOPLE: Final = ("pedestrian", "bicycle")
"""Road users that may take part in a scene, in the words of `road_user`."""

_MOTOR = """
    car truck bus van motorcycle motorbike trailer taxi vehicle truck_bus ambulance automobile coach hgv lorry
    minibus pickup police suv
"""
MOTOR_TYPES = frozenset(_MOTOR.split())
"""Types that become vehicles of a seed scene. An unknown type does so too if it is as large as a vehicle and
drives; all others are obstacles."""

_OTHER = """
    animal bicycle bicyclist bike cyclist escooter human pedestrian pedestrian/bicycle parked person replayed
    rider scooter train tram wheelchair
"""
OTHER_TYPES = frozenset(_OTHER.split())
"""Types that never become vehicles, however large and fast."""

OBSTACLE_SIZES = {"pedestrian": (0.6, 0.6), "bicycle": (1.8, 0.7), "tram": (30.0, 2.6)}
"""Length and width in m if the recording gives none; all other types get those of a bicycle."""

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
