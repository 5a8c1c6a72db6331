"""Tags of a lanelet, its kind and its speed limit; countries, their limits and their side of the road."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from scex_sumo.converters.lanelet.file import MapFile, Relation

MPH = 0.44704  # m/s, by definition (1609.344 m in 3600 s)
KMH = 1 / 3.6
_UNITS = {
    **dict.fromkeys(("", "kmh", "km/h", "kph", "kmph"), KMH),
    **dict.fromkeys(("mph", "mi/h"), MPH),
    **dict.fromkeys(("m/s", "mps"), 1.0),
    "knots": 1852 / 3600,
}
# Limits by name, km/h, and Germany's signs.
_NAMED = {"walk": 7.0, "none": 130.0, "274.1": 30.0, "310": 50.0, "325": 7.0, "325.1": 7.0}
_PLACES = ("urban", "rural", "motorway", "living_street")  # OpenStreetMap's, after a country, e.g. RU:urban
_NUMBER = re.compile(r"([0-9]+(?:[.,][0-9]+)?)\s*([a-z/]*)")
_LIMIT_SIGN = re.compile(r"(?:de[-_: ]?)?274(?:\.1)?[-_ ]([0-9]+)")
_MAX_MPS = 70.0  # 250 km/h; larger numbers are those of signs
# The suffix is the limit itself since 2017; before, 51 to 58 stood for 10 to 80 km/h.
_OLD_SUFFIX = {51: 10, 52: 20, 53: 30, 54: 40, 55: 50, 56: 60, 57: 70, 58: 80}

_PEDESTRIAN = {"walkway", "crosswalk", "shared_walkway", "stairs", "sidewalk", "footway", "pedestrian"}
_BICYCLE = {"bicycle_lane", "bikelane", "bike_lane", "cycleway", "bicycle"}
_BUS = {"bus_lane", "busway", "bus"}
_BY_KIND = {"pedestrian": 5.0, "bicycle": 20.0}


class _Country(NamedTuple):
    name: str
    urban: float
    rural: float
    motorway: float  # the advised speed where there is no limit
    living_street: float = 20.0


_MPH = 1.609344  # km/h
GERMANY = "de"
COUNTRIES = {
    GERMANY: _Country("Germany", 50, 100, 130, 7),
    "at": _Country("Austria", 50, 100, 130),
    "au": _Country("Australia", 50, 100, 110),
    "be": _Country("Belgium", 50, 90, 120),
    "bg": _Country("Bulgaria", 50, 90, 140),
    "ch": _Country("Switzerland", 50, 80, 120),
    "cn": _Country("China", 50, 70, 120),
    "cz": _Country("Czechia", 50, 90, 130),
    "es": _Country("Spain", 50, 90, 120),
    "fr": _Country("France", 50, 80, 130),
    "gb": _Country("Great Britain", 30 * _MPH, 60 * _MPH, 70 * _MPH),
    "ie": _Country("Ireland", 50, 80, 120),
    "in": _Country("India", 70, 70, 120),
    "it": _Country("Italy", 50, 90, 130),
    "jp": _Country("Japan", 60, 60, 100),
    "nl": _Country("the Netherlands", 50, 80, 100, 15),
    "nz": _Country("New Zealand", 50, 100, 100),
    "pl": _Country("Poland", 50, 90, 140),
    "ru": _Country("Russia", 60, 90, 110),
    "sg": _Country("Singapore", 50, 70, 90),
    "us": _Country("the United States", 25 * _MPH, 55 * _MPH, 65 * _MPH),
    "za": _Country("South Africa", 60, 100, 120),
}
_SPEED_KEYS = (
    "speed_limit",
    "speed_limit:vehicle",
    "speed_limit:vehicle:car",
    "maxspeed",
    "maxspeed:forward",
)
_SIGN_KEYS = ("sign_type", "subtype", *_SPEED_KEYS)

_CODES = """
    ag ai au bb bd bm bn bs bt bw ck cy dm fj fk gb gd gg gy hk id ie im in je jm jp ke ki kn ky lc lk ls mo
    ms mt mu mv mw my mz na nf np nr nu nz pg pk pn sb sc sg sh sr sz tc th tk tl to tt tv tz ug vc vg vi ws
    za zm zw AUS GBR HKG IDN IND IRL JPN KEN LKA MYS NZL PAK SGP THA ZAF
"""
LEFT_HAND = frozenset(_CODES.split())
"""Countries with traffic on the left: two letters, as in OpenStreetMap, or three, as in CommonRoad."""
# South, north, west and east in degrees; near land borders with traffic on the right they leave land out.
_AREAS = (
    *((49.9, 61.0, -11.0, 0.9), (50.88, 53.0, 0.9, 1.45), (51.2, 53.0, 1.45, 1.9)),  # Britain, Ireland
    *((49.1, 49.75, -2.75, -1.98), (35.7, 36.2, 14.1, 14.7), (34.5, 35.8, 32.2, 34.7)),  # islands of Europe
    *((24.0, 28.0, 122.9, 131.5), (30.0, 34.75, 129.0, 132.0)),  # Japan
    *((33.0, 35.5, 130.8, 142.5), (35.5, 41.0, 132.0, 142.5), (41.0, 45.8, 139.0, 146.0)),
    *((5.5, 24.5, 67.0, 88.0), (24.0, 27.9, 75.0, 88.9), (27.9, 30.5, 75.0, 80.9)),  # India, Nepal
    *((20.7, 26.9, 88.0, 92.1), (24.0, 27.5, 89.0, 95.0)),  # Bangladesh, Bhutan
    *((23.5, 29.3, 63.4, 75.0), (29.3, 34.6, 71.2, 77.5)),  # Pakistan
    *((12.5, 18.0, 98.9, 102.0), (14.5, 17.3, 102.0, 104.2), (5.5, 12.5, 98.3, 101.0)),  # Thailand
    *((1.2, 6.7, 100.0, 104.6), (-4.5, 7.4, 108.9, 119.2), (-11.5, 5.5, 95.0, 156.0)),  # Malaysia to Papua
    *((22.15, 22.5, 113.8, 114.45), (22.1, 22.22, 113.52, 113.61)),  # Hong Kong, Macau
    *((-44.0, -10.0, 112.0, 154.0), (-48.0, -34.0, 166.0, 179.0), (-19.5, -16.0, 176.5, 180.0)),  # Australia
    *((-35.0, -18.0, 11.5, 41.0), (-18.0, -13.6, 22.0, 41.0), (-13.6, -1.5, 33.0, 42.0)),  # southern Africa
    *((-8.0, -1.2, 31.0, 33.0), (-1.5, 4.0, 34.2, 41.5), (-1.0, 3.5, 30.2, 34.2)),  # Tanzania, Kenya, Uganda
    *((17.6, 18.6, -78.5, -76.1), (23.3, 27.3, -79.4, -74.0), (13.0, 13.4, -59.7, -59.4)),  # Caribbean
    *((10.0, 11.4, -61.95, -60.4), (4.5, 7.0, -58.6, -54.1), (-20.6, -19.9, 57.2, 57.9)),
)


def speed_mps(text: str) -> float | None:
    """Parse a speed limit of a map, m/s; None if it is no speed or zero.

    Examples: ``30 km/h``, ``50kmh``, ``15mph``, ``13.9 m/s``, ``RU:urban`` (of that country), ``none``
    (130 km/h), ``de274-60``.
    """
    word = text.strip().lower()
    sign = _LIMIT_SIGN.fullmatch(word)
    if sign:
        code = int(sign[1])
        return _OLD_SUFFIX.get(code, code) * KMH or None
    country, _, place = word.rpartition(":")
    if place in _PLACES:
        kmh = getattr(COUNTRIES.get(country or GERMANY), place, None)
    else:
        kmh = _NAMED.get(re.sub(r"^de[-_: ]?", "", word))
    if kmh is not None:
        return float(kmh * KMH)
    number = _NUMBER.fullmatch(word)
    limit = float(number[1].replace(",", ".")) * _UNITS.get(number[2], 0.0) if number else 0.0
    return limit if 0.0 < limit <= _MAX_MPS else None


def lane_speed_mps(lanelet: Relation, map_file: MapFile) -> float | None:
    """Return a lanelet's first understood speed limit, m/s, or None.

    ``speed_limit`` elements come before the lanelet's own tags, as in Lanelet2.
    """
    return next(filter(None, map(speed_mps, limit_texts(lanelet, map_file))), None)


def limit_texts(lanelet: Relation, map_file: MapFile) -> Iterator[str]:
    """Yield the texts of a lanelet's speed limits, understood or not."""
    for ref in lanelet.refs("regulatory_element", "relation"):
        element = map_file.relations.get(ref)
        if element is None or element.tags.get("subtype") != "speed_limit":
            continue
        yield from (element.tags[key] for key in _SIGN_KEYS if key in element.tags)
        signs = [map_file.ways[way].tags for way in element.refs("refers", "way") if way in map_file.ways]
        yield from (sign[key] for sign in signs for key in _SIGN_KEYS if key in sign)
    yield from (lanelet.tags[key] for key in _SPEED_KEYS if key in lanelet.tags)


def default_speed_mps(tags: Mapping[str, str], kind: str, country: str = GERMANY) -> float:
    """Return a country's default speed limit for a lanelet, m/s: 5 km/h on foot, 20 km/h on a bicycle."""
    rules = COUNTRIES[country]
    by_subtype = dict.fromkeys(("highway", "emergency_lane"), rules.motorway)
    by_subtype["play_street"] = rules.living_street
    by_place = rules.rural if tags.get("location") == "nonurban" else rules.urban
    return (_BY_KIND.get(kind) or by_subtype.get(tags.get("subtype", ""), by_place)) * KMH


def map_country(map_file: MapFile) -> str:
    """Return the country that most lanelets' ``region`` tags name, e.g. ``us_ca``; empty if none does."""
    regions = (r.tags.get("region", "").lower()[:2] for r in map_file.of_type("lanelet").values())
    known = Counter(filter(str.isalpha, regions))
    return known.most_common(1)[0][0] if known else ""


def lane_kind(tags: Mapping[str, str], *, vehicle: bool) -> str:
    """Return a lane's kind: vehicle (cars may pass), bus, bicycle, pedestrian or other."""
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


def drives_left_at(place: tuple[float, float]) -> bool | None:
    """Return whether traffic drives on the left at a latitude and longitude; None at 0, 0: no real place."""
    latitude, longitude = place
    if abs(latitude) < 1.0 and abs(longitude) < 1.0:
        return None
    return any(s <= latitude <= n and w <= longitude <= e for s, n, w, e in _AREAS)
