"""What the tags of a lanelet say: who may use it, how fast."""

from __future__ import annotations

import re
from collections.abc import Mapping

from scex_sumo.converters.map_file import MapFile

MPH = 0.44704  # m/s, by definition (1609.344 m in 3600 s)
KMH = 1 / 3.6
_UNITS = {
    "": KMH,
    "kmh": KMH,
    "km/h": KMH,
    "kph": KMH,
    "kmph": KMH,
    "mph": MPH,
    "mi/h": MPH,
    "m/s": 1.0,
    "mps": 1.0,
    "ms": 1.0,
    "knots": 1852 / 3600,
}
# OpenStreetMap's words for limits that are not written as a number, km/h.
_WORDS = {"walk": 7.0, "living_street": 7.0, "urban": 50.0, "rural": 100.0, "motorway": 130.0, "none": 130.0}
_NUMBER = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*([a-z/]*)")
# German signs 274 (limit) and 274.1 (zone 30) with the limit as a suffix; US R2-1 says it on the plate.
_SIGN = re.compile(r"de[-_ ]?274(?:\.[12])?(?:[-_ ]([0-9]+))?")
_SUFFIX_KMH = {50: 10, 51: 20, 52: 30, 53: 40, 54: 50, 55: 50, 56: 60, 57: 70, 58: 80, 59: 90}

_PEDESTRIAN = {"walkway", "crosswalk", "shared_walkway", "stairs", "sidewalk", "footway", "pedestrian"}
_BICYCLE = {"bicycle_lane", "bikelane", "bike_lane", "cycleway", "bicycle"}
_BUS = {"bus_lane", "bus"}


def speed_mps(text: str) -> float | None:
    """Speed in m/s of a limit as maps write it, or None where it is no speed.

    A number without a unit is in km/h; ``30 km/h``, ``50kmh``, ``15mph``, ``13.9 m/s``, ``DE:urban``,
    ``none`` (taken as 130 km/h) and the German sign ``de274-56`` are understood. Zero is no limit.
    """
    word = text.strip().lower()
    sign = _SIGN.fullmatch(word)
    if sign:
        return _sign_kmh(word, sign[1]) * KMH
    number = _NUMBER.fullmatch(word)
    if number:
        unit = _UNITS.get(number[2])
        value = float(number[1].replace(",", "."))
        return value * unit if unit is not None and value > 0 else None
    kmh = _WORDS.get(word.rsplit(":", 1)[-1])
    return kmh * KMH if kmh is not None else None


def _sign_kmh(word: str, suffix: str | None) -> float:
    if suffix is None:
        return 30.0 if "274.1" in word else 50.0
    code = int(suffix)
    return float(_SUFFIX_KMH.get(code, code))


def lane_kind(tags: Mapping[str, str], *, vehicle: bool, bicycle: bool, pedestrian: bool) -> str:
    """Kind of a lane: ``vehicle``, ``bus``, ``bicycle``, ``pedestrian`` or ``other``.

    Args:
        tags: the lanelet's tags.
        vehicle: whether the traffic rules let cars pass.
        bicycle: whether they let cyclists pass.
        pedestrian: whether they let pedestrians pass.
    """
    if vehicle:
        return "vehicle"
    subtype = tags.get("subtype", "")
    if subtype in _BUS or tags.get("participant:vehicle:bus") == "yes":
        return "bus"
    if subtype in _PEDESTRIAN:
        return "pedestrian"
    if bicycle or subtype in _BICYCLE:
        return "bicycle"
    return "pedestrian" if pedestrian else "other"


def tagged_speed_mps(tags: Mapping[str, str]) -> float | None:
    """Speed limit that a lanelet's own tags give, m/s, or None."""
    for key in ("speed_limit", "maxspeed", "speed_limit:vehicle"):
        if key in tags:
            speed = speed_mps(tags[key])
            if speed is not None:
                return speed
    return None


def regulated_speed_mps(lane_id: int, map_file: MapFile) -> float | None:
    """Speed limit of a lanelet's ``speed_limit`` regulatory elements, m/s, or None; the lowest counts.

    An element says its limit itself (``sign_type``, as INTERACTION's maps have it) or by the subtype of the
    signs that it refers to.
    """
    found = []
    for ref in map_file.relations[lane_id].refs("regulatory_element", "relation"):
        element = map_file.relations.get(ref)
        if element is None or element.tags.get("subtype") != "speed_limit":
            continue
        texts = [element.tags.get(key) for key in ("sign_type", "speed_limit", "maxspeed", "limit")]
        for way in element.refs("refers", "way"):
            if way in map_file.ways:
                texts += [map_file.ways[way].tags.get(key) for key in ("subtype", "sign_type")]
        found += [speed for text in texts if text and (speed := speed_mps(text)) is not None]
    return min(found, default=None)
