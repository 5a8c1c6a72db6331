"""Intention of a vehicle of a SUMO simulation: its route, type and stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

PARKS: Final = 1
"""Flag of a stop beside the lane."""
MAX_BEHIND: Final = 3
"""Edges on which the body of a vehicle may still be."""


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Planned stop of a vehicle, as SUMO counts along its lanes.

    Attributes:
        lane: SUMO's name of the lane.
        start_m: begin of the place on the lane; ``end_m`` its end, where the front bumper stands.
        duration_s: time from the arrival on; of a vehicle that stands there already, the rest.
        until_s: earliest departure, s after the seed moment; negative without one.
        flags: of SUMO's ``setStop``.
    """

    lane: str
    start_m: float
    end_m: float
    duration_s: float
    until_s: float = -1.0
    flags: int = 0


class Walk(NamedTuple):
    """Walk of a person of a SUMO simulation: edges, and where it ends on the last one, m; () unknown.

    ``saved`` is what SUMO's saved state has of the person, or of a bicycle.
    """

    edges: tuple[str, ...] = ()
    arrival_m: float = 0.0
    saved: str = ""


@dataclass(frozen=True, kw_only=True)
class Intention:
    """What a SUMO simulation knows of one of its vehicles: its route, type and stops.

    Attributes:
        edges: SUMO's edges of the route from the vehicle's on.
        behind: edges of the route before these, on which its body may still be.
        model: SUMO's name of its car-following model.
        vehicle_class: SUMO's class, e.g. ``taxi``.
        parameters: attributes of its ``vType`` that make no driver random.
        speed_factor: desired speed over the limit.
        stops: the next ones, in order.
        change_mps: lateral speed while it changes its lane, positive to the left, else 0.
        lanes: lanes of the road along the route, those within junctions included.
        arrival: where it arrives on the last edge, in SUMO's words: a place in m, or e.g. ``max``.
        arrives: x, y in m and heading of its front bumper there, on each lane.
        saved: what SUMO's saved state has of it, as of `saved.road_users`; "" without one.
    """

    edges: tuple[str, ...]
    behind: tuple[str, ...] = ()
    model: str = "Krauss"
    vehicle_class: str = "passenger"
    parameters: Mapping[str, str] = field(default_factory=dict)
    speed_factor: float = 1.0
    stops: tuple[Stop, ...] = ()
    change_mps: float = 0.0
    lanes: frozenset[int] = frozenset()
    arrival: str = "max"
    arrives: tuple[tuple[float, float, float], ...] = ()
    saved: str = ""
