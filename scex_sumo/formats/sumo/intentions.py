"""Intentions of a running simulation's vehicles: routes, types and stops."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.sumo.car_following import RANDOM_PARAMETERS, REFUSED, WORDS, known_parameters
from scex_sumo.converters.net.parts import lane_places
from scex_sumo.converters.net.reading import read_ends
from scex_sumo.converters.net.sumo_net import points_of
from scex_sumo.converters.xml import net_root
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.intention import MAX_BEHIND, PARKS, Intention, Stop

INTENTIONS_S = 1.0  # between records of intentions
MAX_EDGES, MAX_STOPS = 50, 3  # of a vehicle that are kept
_TRIGGERED_S = 1000.0  # of a stop that waits for somebody
_SIDEWAYS_MPS = 0.01  # slower vehicles change no lane
_TRIGGERED = 2 + 4  # bits of a planned stop's flags


def intentions_now(
    vehicles: Any,
    names: Iterable[str],
    types: Mapping[str, Mapping[str, str]],
    arrivals: Mapping[str, str],
    model: str,
    time_s: float,
) -> Iterator[tuple[str, Intention]]:
    """Yield the name of each vehicle of the present step, and what it is to do.

    Args:
        vehicles: the connection's domain of vehicles.
        names: of the vehicles.
        types: as of `types_and_arrivals`, so ``arrivals``.
        model: the simulation's car-following model, for types that name none.
    """
    for name in names:
        attributes = types.get(str(vehicles.getTypeID(name)), {})
        index = max(int(vehicles.getRouteIndex(name)), 0)
        route = vehicles.getRoute(name)[max(index - MAX_BEHIND, 0) : index + MAX_EDGES]
        behind, stops = min(index, MAX_BEHIND), range(len(vehicles.getStops(name, MAX_STOPS)))
        sideways = float(vehicles.getLateralSpeed(name))
        yield (
            name,
            Intention(
                edges=tuple(map(sys.intern, route[behind:])),
                behind=tuple(map(sys.intern, route[:behind])),
                model=attributes.get("carFollowModel", model),
                vehicle_class=str(vehicles.getVehicleClass(name)),
                parameters=_usable_parameters(attributes),
                speed_factor=float(vehicles.getSpeedFactor(name)),
                stops=tuple(_stop(vehicles, name, k, time_s) for k in stops),
                change_mps=sideways if abs(sideways) > _SIDEWAYS_MPS else 0.0,
                arrival=arrivals.get(name, "max"),
            ),
        )


def _stop(vehicles: Any, name: str, index: int, time_s: float) -> Stop:
    def asked(key: str) -> float:
        value = vehicles.getStopParameter(name, index, key)
        return float(value) if value else -1.0

    stop = vehicles.getStops(name, index + 1)[index]
    waits = stop.stopFlags & _TRIGGERED
    duration, started = max(float(stop.duration), 0.0), asked("started")
    if started >= 0:
        duration = max(duration - (time_s - started), 0.0)
    return Stop(
        lane=str(stop.lane),
        start_m=float(stop.startPos),
        end_m=float(stop.endPos),
        duration_s=_TRIGGERED_S if waits else duration,
        until_s=float(stop.until) if stop.until >= 0 else -1.0,
        flags=int(stop.stopFlags) & PARKS,
    )


def intention_at(
    changes: Sequence[tuple[float, Intention]], time_s: float, *, asked: bool
) -> Intention | None:
    """Return the last intention before a time, else the first one after it; stops count from the time.

    Args:
        asked: whether all intentions were recorded at this time; else changes of lanes are unknown.
    """
    if not changes:
        return None
    known = [intention for since_s, intention in changes if since_s <= time_s + 1e-6]
    intention = known[-1] if known else changes[0][1]
    untils = [stop.until_s - time_s if stop.until_s >= 0 else -1.0 for stop in intention.stops]
    stops = tuple(dataclasses.replace(s, until_s=t) for s, t in zip(intention.stops, untils, strict=True))
    change_mps = intention.change_mps if asked else 0.0
    return dataclasses.replace(intention, stops=stops, change_mps=change_mps)


def with_lanes(net: Path, intentions: Sequence[Intention | None]) -> tuple[Intention | None, ...]:
    """Return intentions with the lanes of the net's road along their routes, and where these end."""
    root = net_root(net)
    under = {name: [number for number, _ in places] for name, places in lane_places(root)}
    of_edge: dict[str, set[int]] = {}
    for name, numbers in under.items():
        of_edge.setdefault(name.rpartition("_")[0], set()).update(numbers)
    within: dict[tuple[str, str], set[int]] = {}
    for name, ends in read_ends(root).items():
        within.setdefault(ends, set()).update(under.get(name, ()))

    def lanes(edges: Sequence[str]) -> frozenset[int]:
        parts = [of_edge.get(edge, set()) for edge in edges]
        parts += [within.get(ends, set()) for ends in pairwise(edges)]
        return frozenset().union(*parts)

    last = {known.edges[-1] for known in intentions if known and known.edges}
    edges = {edge.get("id", ""): edge for edge in root.iter("edge") if edge.get("id") in last}

    def placed(known: Intention) -> Intention:
        once = known.edges.count(known.edges[-1]) == 1 and len(known.edges) < MAX_EDGES
        arrives = _arrives(edges[known.edges[-1]], known.arrival) if once else ()
        return dataclasses.replace(known, lanes=lanes(known.edges), arrives=arrives)

    return tuple(placed(known) if known and known.edges else known for known in intentions)


def _arrives(edge: ElementTree.Element, arrival: str) -> tuple[tuple[float, float, float], ...]:
    """Return x, y and heading on each lane of an edge at a place in SUMO's words."""
    places = []
    for lane in edge.iter("lane"):
        shape, length = points_of(lane.get("shape", "")), float(lane.get("length", "nan"))
        known = {"max": length, "center": length / 2}
        try:
            place_m = known[arrival] if arrival in known else float(arrival)
        except ValueError:
            return ()  # random, or a place that is left or right of the lane's middle
        share = min(max(place_m + length if place_m < 0 else place_m, 0.0), length) / length
        (x, y), whole = along(shape, share * length_of(shape)), length_of(shape)
        before, after = along(shape, np.clip(share * whole + np.array([-1.0, 1.0]), 0.0, whole))
        places.append((float(x), float(y), float(np.arctan2(*(after - before)[::-1]))))
    return tuple(places)


def _usable_parameters(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of a ``vType`` that are parameters of its driver and make it not random."""
    usable = known_parameters() - {*REFUSED, *RANDOM_PARAMETERS, "speedFactor", "probability"}
    number = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")
    return {
        key: value
        for key, value in attributes.items()
        if key in usable and (number.fullmatch(value) or value in WORDS.get(key, ()))
    }
