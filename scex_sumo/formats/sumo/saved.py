"""Saved states of a running SUMO simulation: types, arrivals, and all that SUMO knows of each road user."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scex_sumo.base.files import TemporaryFolder
from scex_sumo.intention import Intention

PRECISE = {"save-state.transportables": "true", "save-state.precision": "12"}
"""Options with which a state has persons, and positions to the last digit."""
# What belongs to the user's files alone, or to devices.
_VEHICLE = {"route", "reroute", "via", "line", "from", "to", "insertionChecks"}
_VEHICLE |= {"personNumber", "containerNumber"}
_STOP = ("lane", "startPos", "endPos", "duration", "until", "parking", "triggered", "started", "speed")
_WALK = ("edges", "arrivalPos", "started", "ended", "waitingTime", "speed", "duration")
_EDGES_BEHIND, _PAST_STOPS = 2, 9  # places of their numbers in a vehicle's state
_WALKING_AREA = re.compile(r" :\S*_w\d+_0 [\d.]+ .* :\S*_c\d+_0")  # on one, before a crossing


def saved_state(sumo: Any) -> bytes:
    """Return the packed state of a simulation; empty if it cannot write one here."""
    with TemporaryFolder() as folder:
        file = Path(folder, "state.xml")
        sumo.simulation.saveState(str(file))
        return zlib.compress(file.read_bytes(), 1) if file.is_file() else b""


def person_label(name: str, *, taken: bool) -> str:
    """Return the name of a person's track; ``taken`` by a vehicle of the same name."""
    return f"{name}_person" if taken else name


def types_and_arrivals(state: bytes) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return the attributes of the vehicle types in a packed state, and where vehicles arrive."""
    root = _root(state)
    arrivals = {v.get("id", ""): v.get("arrivalPos", "max") for v in root.iter("vehicle")}
    return {kind.get("id", ""): dict(kind.attrib) for kind in root.iter("vType")}, arrivals


def saved_lights(state: bytes) -> list[Element]:
    """Return the programmes of the lights in a packed state."""
    return list(_root(state).iter("tlLogic"))


def road_users(state: bytes) -> dict[str, Element]:
    """Return vehicles on the road and walking persons of a packed state by the names of their tracks.

    Each is an element with ``vType`` and ``vehicle`` or ``person``; its ``lane`` and ``order`` are where a
    vehicle is.
    """
    root = _root(state)
    types = {kind.get("id", ""): kind for kind in root.iter("vType")}
    users = {}

    def user(element: Element, plain: Element, **place: str) -> Element:
        user = Element("user", place)
        user.extend([types[kind]] if (kind := element.get("type", "")) in types else [])
        user.append(plain)
        return user

    vehicles = {vehicle.get("id", ""): vehicle for vehicle in root.iter("vehicle")}
    for lane in root.iter("lane"):
        for order, name in enumerate(" ".join(e.get("value", "") for e in lane.iter("vehicles")).split()):
            if (vehicle := vehicles.get(name)) is not None:
                place = {"lane": lane.get("id", ""), "order": str(order)}
                users[name] = user(vehicle, _plain(vehicle), **place)
    for person in root.iter("person"):
        if (walker := _walking(person)) is not None:
            name = person.get("id", "")
            users[person_label(name, taken=name in users)] = user(person, walker)
    return users


def text_of(user: Element, intention: Intention | None) -> str:
    """Return a road user of `road_users` as text, a vehicle with the route and stops of its intention."""
    vehicle = user.find("vehicle")
    if vehicle is not None and intention is not None:
        edges, words = (*intention.behind, *intention.edges), vehicle.get("state", "").split()
        words[_EDGES_BEHIND] = str(len(intention.behind))
        vehicle.set("state", " ".join(words))
        user.set("edges", " ".join(edges))
        for stop, place in zip(vehicle.findall("stop"), intention.stops, strict=False):
            stop.attrib |= {"lane": place.lane, "startPos": str(place.start_m), "endPos": str(place.end_m)}
        for stop in [stop for stop in vehicle if stop.get("lane", "").rpartition("_")[0] not in edges]:
            vehicle.remove(stop)
    return ElementTree.tostring(user, encoding="unicode")


def _plain(vehicle: Element) -> Element:
    """Return a vehicle without devices, past stops, and names of the user's other files."""
    plain = Element("vehicle", {k: v for k, v in vehicle.attrib.items() if k not in _VEHICLE})
    words = vehicle.get("state", "").split()
    words[_PAST_STOPS] = "0"
    plain.set("state", " ".join(words))
    for stop in vehicle.iter("stop"):
        if "ended" not in stop.attrib:
            parks = {"parking": "true"} if "parkingArea" in stop.attrib else {}
            ElementTree.SubElement(plain, "stop", {**_some(stop.attrib, _STOP), **parks})
    return plain


def _walking(person: Element) -> Element | None:
    """Return a person that walks, without the earlier and later stages of its plan; None if it does not.

    SUMO 1.28 loses that somebody who waits or goes on a walking area will cross: vehicles would not stop.
    """
    words = person.get("state", "").split()
    stage = int(words[1]) - 1 if len(words) > 3 else -1
    walks = 0 <= stage < len(person) and person[stage].tag == "walk"
    if not walks or _WALKING_AREA.search(person.get("state", "")):
        return None
    walker = Element("person", {**person.attrib, "state": " ".join([words[0], "1", *words[2:]])})
    ElementTree.SubElement(walker, "walk", _some(person[stage].attrib, _WALK))
    return walker


def _some(attributes: Mapping[str, str], names: tuple[str, ...]) -> dict[str, str]:
    return {key: value for key, value in attributes.items() if key in names}


def _root(state: bytes) -> Element:
    return ElementTree.fromstring(zlib.decompress(state)) if state else Element("snapshot")
