"""Check of roads that others made: lanes that exist, limits, widths, lines with a length."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.errors import MapError
from scex_sumo.road import Lane, Regulation, Road

_NAMES = ("successors", "predecessors", "conflicts", "left", "right", "adjacent_left", "adjacent_right")
_RULED = ("lanes", "yielding", "priority")


def check_road(road: Road, said: str) -> None:
    """Raise a `MapError` for what no road can have; ``said`` names it in the message."""
    for number, lane in road.lanes.items():
        if lane.lane_id != number:
            raise MapError(f"{said}: lane {number}: its lane_id is {lane.lane_id}; give it its key in lanes")
        _check_names(road, lane, (*_NAMES, "reverse_of"), f"{said}: lane {number}")
        for name in ("width_m", "speed_limit_mps"):
            if not 0 < (value := getattr(lane, name)) < np.inf:
                raise MapError(f"{said}: lane {number}: {name} is {value}; needs more than 0")
        for name in ("centreline", "left_bound", "right_bound"):
            line = np.asarray(getattr(lane, name))
            if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 or not np.isfinite(line).all():
                raise MapError(f"{said}: lane {number}: {name} is no line of 2 or more finite points (P, 2)")
    for rule in road.regulations:
        _check_names(road, rule, _RULED, f"{said}: regulation {rule.element_id}")


def _check_names(road: Road, element: Lane | Regulation, names: tuple[str, ...], said: str) -> None:
    for name in names:
        value = getattr(element, name)
        for other in value if isinstance(value, tuple) else () if value is None else (value,):
            if other not in road.lanes:
                raise MapError(f"{said}: {name} names {other}, which is no lane of the map")
