"""Tags of a lanelet and its regulatory elements: who may use it, how fast."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from scex_sumo.converters.lanelet.file import MapFile, Relation
from scex_sumo.errors import UsageError

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
_BY_KIND = {"pedestrian": 5.0, "bicycle": 20.0}


@dataclass(frozen=True, kw_only=True)
class Country:
    """Speed limits for cars where no sign stands, km/h; usual ones where they differ from state to state.

    Attributes:
        name: in English.
        urban: in towns.
        rural: outside of them.
        motorway: on motorways; the advised speed where there is no limit.
        living_street: where children play.
    """

    name: str
    urban: float
    rural: float
    motorway: float
    living_street: float = 20.0


_MPH = 1.609344  # km/h
GERMANY = "de"
COUNTRIES = {
    GERMANY: Country(name="Germany", urban=50, rural=100, motorway=130, living_street=7),
    "at": Country(name="Austria", urban=50, rural=100, motorway=130),
    "be": Country(name="Belgium", urban=50, rural=90, motorway=120),
    "bg": Country(name="Bulgaria", urban=50, rural=90, motorway=140),
    "ch": Country(name="Switzerland", urban=50, rural=80, motorway=120),
    "cn": Country(name="China", urban=50, rural=70, motorway=120),
    "cz": Country(name="Czechia", urban=50, rural=90, motorway=130),
    "es": Country(name="Spain", urban=50, rural=90, motorway=120),
    "fr": Country(name="France", urban=50, rural=80, motorway=130),
    "gb": Country(name="Great Britain", urban=30 * _MPH, rural=60 * _MPH, motorway=70 * _MPH),
    "it": Country(name="Italy", urban=50, rural=90, motorway=130),
    "nl": Country(name="the Netherlands", urban=50, rural=80, motorway=100, living_street=15),
    "pl": Country(name="Poland", urban=50, rural=90, motorway=140),
    "us": Country(name="the United States", urban=25 * _MPH, rural=55 * _MPH, motorway=65 * _MPH),
}
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


def default_speed_mps(tags: Mapping[str, str], kind: str, country: str = GERMANY) -> float:
    """A country's speed limit where the map gives none, m/s.

    Args:
        tags: the lanelet's tags.
        kind: the lane's kind; pedestrians are taken to walk at 5 km/h, cyclists to ride at 20 km/h.
        country: one of `COUNTRIES`.
    """
    rules = COUNTRIES[country]
    by_subtype = dict.fromkeys(("highway", "emergency_lane"), rules.motorway)
    by_subtype["play_street"] = rules.living_street
    by_place = rules.rural if tags.get("location") == "nonurban" else rules.urban
    return (_BY_KIND.get(kind) or by_subtype.get(tags.get("subtype", ""), by_place)) * KMH


def parse_country(text: str) -> str:
    """Read ``--country``: a code such as ``us``, in any case.

    Raises:
        UsageError: its limits are not known.
    """
    if text.lower() not in COUNTRIES:
        raise UsageError(f"--country: unknown country {text!r}; known: {', '.join(COUNTRIES)}")
    return text.lower()


def map_country(map_file: MapFile) -> str:
    """The country that most lanelets' ``region`` tags name, e.g. ``us``, ``us_ca``; Germany if none does."""
    regions = (r.tags.get("region", "").lower()[:2] for r in map_file.of_type("lanelet").values())
    known = Counter(region for region in regions if region in COUNTRIES)
    return known.most_common(1)[0][0] if known else GERMANY


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
