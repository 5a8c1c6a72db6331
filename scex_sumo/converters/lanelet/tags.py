"""Tags of a lanelet and its regulatory elements: who may use it, how fast."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from scex_sumo.converters.lanelet.file import MapFile, Relation

MPH = 0.44704  # m/s, by definition (1609.344 m in 3600 s)
KMH = 1 / 3.6
_UNITS = {
    **dict.fromkeys(("", "kmh", "km/h", "kph", "kmph"), KMH),
    **dict.fromkeys(("mph", "mi/h"), MPH),
    **dict.fromkeys(("m/s", "mps"), 1.0),
    "knots": 1852 / 3600,
}
# Limits by name, km/h: OpenStreetMap's country defaults and Germany's signs.
_NAMED = {
    "walk": 7.0,
    "living_street": 7.0,
    "urban": 50.0,
    "rural": 100.0,
    "motorway": 130.0,
    "none": 130.0,
    "de274.1": 30.0,
    "de310": 50.0,
    "de325": 7.0,
    "de325.1": 7.0,
}
_NUMBER = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*([a-z/]*)")
_LIMIT_SIGN = re.compile(r"de[-_ ]?274(?:\.1)?[-_ ]([0-9]+)")
# The suffix is the limit itself since 2017; before, 51 to 58 stood for 10 to 80 km/h.
_OLD_SUFFIX = {51: 10, 52: 20, 53: 30, 54: 40, 55: 50, 56: 60, 57: 70, 58: 80}

_PEDESTRIAN = {"walkway", "crosswalk", "shared_walkway", "stairs", "sidewalk", "footway", "pedestrian"}
_BICYCLE = {"bicycle_lane", "bikelane", "bike_lane", "cycleway", "bicycle"}
_BUS = {"bus_lane", "busway", "bus"}
# Germany's limits by subtype and location as Lanelet2's traffic rules have them, km/h.
_BY_SUBTYPE = {"highway": 130.0, "play_street": 7.0, "emergency_lane": 130.0}
_BY_KIND = {"pedestrian": 5.0, "bicycle": 20.0}
_BY_LOCATION = {"nonurban": 100.0}
_URBAN = 50.0
_SPEED_KEYS = (
    "speed_limit",
    "speed_limit:vehicle",
    "speed_limit:vehicle:car",
    "maxspeed",
    "maxspeed:forward",
)
_SIGN_KEYS = ("sign_type", "subtype", *_SPEED_KEYS)


def speed_mps(text: str) -> float | None:
    """Speed in m/s of a limit as maps write it, or None where it is no speed.

    A number without a unit is in km/h; ``30 km/h``, ``50kmh``, ``15mph``, ``13.9 m/s``, ``DE:urban``,
    ``none`` (taken as 130 km/h) and the German sign ``de274-60`` are understood. Zero is no limit.
    """
    word = text.strip().lower()
    sign = _LIMIT_SIGN.fullmatch(word)
    if sign:
        code = int(sign[1])
        return _OLD_SUFFIX.get(code, code) * KMH or None
    number = _NUMBER.fullmatch(word)
    if number:
        unit = _UNITS.get(number[2], 0.0)
        return float(number[1].replace(",", ".")) * unit or None
    kmh = _NAMED.get(word.rsplit(":", 1)[-1])
    return kmh * KMH if kmh is not None else None


def lane_speed_mps(lanelet: Relation, map_file: MapFile) -> float | None:
    """Speed limit that the map gives for a lanelet, m/s, or None where it gives none.

    ``speed_limit`` regulatory elements come before the lanelet's own tags, as in Lanelet2; of several the
    first that is understood counts.
    """
    speeds = (speed_mps(text) for text in _limits(lanelet, map_file))
    return next((speed for speed in speeds if speed is not None), None)


def says_limit(lanelet: Relation, map_file: MapFile) -> bool:
    """Whether the map gives a speed limit for a lanelet, understood or not."""
    return any(True for _ in _limits(lanelet, map_file))


def _limits(lanelet: Relation, map_file: MapFile) -> Iterator[str]:
    """Everything that may be a limit, as written: elements, their signs, the lanelet's tags."""
    for ref in lanelet.refs("regulatory_element", "relation"):
        element = map_file.relations.get(ref)
        if element is None or element.tags.get("subtype") != "speed_limit":
            continue
        yield from (element.tags[key] for key in _SIGN_KEYS if key in element.tags)
        signs = [map_file.ways[way].tags for way in element.refs("refers", "way") if way in map_file.ways]
        yield from (sign[key] for sign in signs for key in _SIGN_KEYS if key in sign)
    yield from (lanelet.tags[key] for key in _SPEED_KEYS if key in lanelet.tags)


def default_speed_mps(tags: Mapping[str, str], kind: str) -> float:
    """Germany's speed limit where the map gives none, m/s.

    Args:
        tags: the lanelet's tags.
        kind: the lane's kind; pedestrians are taken to walk at 5 km/h, cyclists to ride at 20 km/h.
    """
    by_place = _BY_LOCATION.get(tags.get("location", ""), _URBAN)
    return (_BY_KIND.get(kind) or _BY_SUBTYPE.get(tags.get("subtype", ""), by_place)) * KMH


def lane_kind(tags: Mapping[str, str], *, vehicle: bool) -> str:
    """Kind of a lane: ``vehicle``, ``bus``, ``bicycle``, ``pedestrian`` or ``other``.

    Args:
        tags: the lanelet's tags.
        vehicle: whether the traffic rules let cars pass.
    """
    if vehicle:
        return "vehicle"
    subtype = tags.get("subtype", "")
    for kind, subtypes in (("bus", _BUS), ("pedestrian", _PEDESTRIAN), ("bicycle", _BICYCLE)):
        if subtype in subtypes:
            return kind
    for kind, participant in (("bus", "vehicle:bus"), ("bicycle", "bicycle"), ("pedestrian", "pedestrian")):
        if tags.get(f"participant:{participant}") == "yes":
            return kind
    return "other"
