"""CommonRoad's lanelet types, road users, markings and signs as properties of a lane."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Regulation

CARS = {"vehicle", "car"}
# In order of precedence.
_KINDS = {
    "crosswalk": "pedestrian",
    "sidewalk": "pedestrian",
    "bicycleLane": "bicycle",
    "busLane": "bus",
    "busStop": "bus",
    "restricted": "bus",
}
_NEVER_DRIVEN = {"border", "parking", "restricted_area", "shoulder"}
_SUBTYPES = {
    "crosswalk": "crosswalk",
    "sidewalk": "walkway",
    "bicycleLane": "bicycle_lane",
    "busLane": "bus_lane",
    "restricted": "bus_lane",
    "parking": "parking",
    "restricted_area": "keepout",
    "shoulder": "emergency_lane",
    "highway": "highway",
    "interstate": "highway",
}
_NO_CROSSING = {"solid", "broad_solid", "solid_solid", "curb", "lowered_curb"}
# Lanelet2's type and subtype of the markings that are drawn.
LINES = {
    "dashed": ("line_thin", "dashed"),
    "solid": ("line_thin", "solid"),
    "broad_dashed": ("line_thick", "dashed"),
    "broad_solid": ("line_thick", "solid"),
    "solid_solid": ("line_thin", "solid_solid"),
    "dashed_dashed": ("line_thin", "dashed"),
    "solid_dashed": ("line_thin", "solid_dashed"),
    "dashed_solid": ("line_thin", "dashed_solid"),
    "curb": ("curbstone", "high"),
    "lowered_curb": ("curbstone", "low"),
}
_SIGN_KINDS = {"YIELD": "yield", "STOP": "stop", "STOP_4_WAY": "all_way_stop"}
_PRIORITY_SIGNS = {"PRIORITY", "RIGHT_OF_WAY"}
_SPEED_SIGNS = ("MAX_SPEED", "MAX_SPEED_ZONE_START")
MAX_LIMIT_MPS = 70.0  # no limit is above 250 km/h; greater numbers are km/h by mistake


@dataclass(frozen=True, kw_only=True)
class Sign:
    """Element of a traffic sign.

    Attributes:
        name: CommonRoad's name, the same in every country, e.g. ``YIELD``, ``MAX_SPEED``.
        written: as the file has it, e.g. ``205``.
    """

    name: str
    written: str
    values: tuple[str, ...] = ()


def kind_by_types(types: frozenset[str], users: frozenset[str]) -> str:
    """Kind of a lane: ``vehicle``, ``bus``, ``bicycle``, ``pedestrian`` or ``other``."""
    if types & _NEVER_DRIVEN:
        return "other"
    if users & CARS:
        return "vehicle"
    by_type = next((kind for name, kind in _KINDS.items() if name in types), None)
    if by_type is not None:
        return by_type
    if not users:
        return "vehicle"
    return next((kind for kind in ("bus", "bicycle", "pedestrian") if kind in users), "other")


def lane_tags(types: frozenset[str]) -> dict[str, str]:
    """CommonRoad's lanelet types as Lanelet2's ``subtype`` and ``location``."""
    subtype = next((word for name, word in _SUBTYPES.items() if name in types), "road")
    location = "urban" if "urban" in types else "nonurban" if "country" in types else ""
    return {"subtype": subtype, "location": location}


def sign_speed_mps(signs: Iterable[Sign]) -> float | None:
    """Lowest speed limit of a lanelet's signs; None without one.

    Raises:
        ValueError: a speed limit is no speed in m/s.
    """
    limits = [float(sign.values[0] if sign.values else "nan") for sign in signs if sign.name in _SPEED_SIGNS]
    if not all(math.isfinite(limit) and 0.0 < limit <= MAX_LIMIT_MPS for limit in limits):
        raise ValueError(limits)
    return min(limits, default=None)


def may_cross(marking: str, *, leftwards: bool) -> bool:
    """Whether a lane change is allowed; the first word of ``dashed_solid`` is the left half of the line."""
    if marking in _NO_CROSSING:
        return False
    return marking != ("dashed_solid" if leftwards else "solid_dashed")


def sign_regulations(
    signs: Mapping[int, tuple[Sign, ...]],
    users: Mapping[int, tuple[int, ...]],
    stop_lines: Mapping[int, FloatArray],
) -> list[Regulation]:
    """Regulations by yield and stop signs; ``users``: vehicle lanes of each sign."""
    rules = []
    for sign_id, elements in signs.items():
        kind = next((_SIGN_KINDS[sign.name] for sign in elements if sign.name in _SIGN_KINDS), None)
        lanes = users.get(sign_id, ())
        if kind is not None and lanes:
            rules.append(
                Regulation(
                    element_id=sign_id,
                    kind=kind,
                    lanes=lanes,
                    yielding=lanes,
                    stop_lines=tuple(stop_lines[i] for i in lanes if i in stop_lines),
                    signs=tuple(sign.written for sign in elements),
                )
            )
    return rules


def priority_regulations(
    incoming: Mapping[int, list[tuple[int, ...]]], lane_signs: Mapping[int, tuple[Sign, ...]]
) -> list[Regulation]:
    """Right of way of incoming lanes with a priority sign over those without, for each intersection."""
    rules = []
    for intersection, groups in incoming.items():
        first = {
            group
            for group in groups
            if any(sign.name in _PRIORITY_SIGNS for i in group for sign in lane_signs.get(i, ()))
        }
        priority = tuple(i for group in groups if group in first for i in group)
        yielding = tuple(i for group in groups if group not in first for i in group if i not in priority)
        if priority and yielding:
            rules.append(
                Regulation(
                    element_id=intersection,
                    kind="right_of_way",
                    lanes=(*yielding, *priority),
                    yielding=yielding,
                    priority=priority,
                )
            )
    return rules
