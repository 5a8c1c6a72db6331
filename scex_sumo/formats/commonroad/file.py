"""CommonRoad file: its XML, its lanelets as plain data, notes about defects; only here: commonroad-io.

Broken parts are mended or left out: commonroad-io stops at the first broken element; the standard library
keeps the sound ones.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.naming import number
from scex_sumo.converters.xml import xml_root
from scex_sumo.formats.lane_maps.lane_map import DrawnMap

ReadSign: TypeAlias = Callable[[ElementTree.Element, str], str]

VERSIONS = ("2018b", "2020a")
MAX_ID = 2**52  # other tools keep ids as floats; those of opposite lanes are greater
_ROOTS = {
    "osm": "it is an OSM file, rename it to .osm for Lanelet2",
    "net": "it is a SUMO net already",
    "OpenDRIVE": "it is OpenDRIVE; rename it to .xodr",
}


class Sign(NamedTuple):
    """Element of a traffic sign.

    Attributes:
        name: CommonRoad's name, the same in every country, e.g. ``YIELD``, ``MAX_SPEED``.
        written: as the file has it, e.g. ``205``.
    """

    name: str
    written: str
    values: tuple[str, ...] = ()


@dataclass(kw_only=True, eq=False)
class CommonRoadFile(DrawnMap):
    """The contents of one CommonRoad file."""

    root: ElementTree.Element

    def elements(self, tag: str) -> dict[int, ElementTree.Element]:
        """Elements of a tag right below the root by ascending id; the first of several with one id."""
        by_id: dict[int, ElementTree.Element] = {}
        for element in self.root.findall(tag):
            number = element_id(element)
            if number is not None:
                by_id.setdefault(number, element)
        return dict(sorted(by_id.items()))

    @property
    def country(self) -> str:
        """Three letters of the signs' country, e.g. ``DEU``, from the benchmark id."""
        return self.root.get("benchmarkID", "").removeprefix("C-")[:3]

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the file's location; None if it has none."""
        texts = [self.root.findtext(f"location/{name}") for name in ("gpsLatitude", "gpsLongitude")]
        lat, lon = (coordinate(text) for text in texts)
        # 999 and -999 stand for unknown.
        return (lat, lon) if abs(lat) <= 90 and abs(lon) <= 180 else None


def parse_commonroad(path: Path) -> ElementTree.Element:
    """Root of a CommonRoad file."""
    root = xml_root(path, remedy="name a CommonRoad .xml file")
    if root.tag != "commonRoad":
        what = _ROOTS.get(root.tag, "name a CommonRoad scenario")
        raise MapError(f"{path}: no CommonRoad file, its root is <{root.tag}>: {what}")
    version = root.get("commonRoadVersion", "")
    if version not in VERSIONS:
        raise MapError(
            f"{path}: CommonRoad version {version[:24]!r}; {' and '.join(VERSIONS)} can be read, write it "
            "anew with commonroad-io"
        )
    return root


def element_id(element: ElementTree.Element, attribute: str = "id") -> int | None:
    """Id of an element; None if it is not a positive number."""
    text = element.get(attribute, "").strip()
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0
    return value if 0 < value < MAX_ID else None


def coordinate(text: str | None) -> float:
    """Number that a text holds, or nan; a coordinate, time or size is below 1e9."""
    value = number(text)
    return value if abs(value) < 1e9 else math.nan


def bounds_of(xml: ElementTree.Element, i: int, file: CommonRoadFile) -> tuple[FloatArray, FloatArray] | None:
    """Return the bounds of a lanelet; None, and a note, if they are not usable."""
    elements = [xml.find(name) for name in ("leftBound", "rightBound")]
    lines = [points_of(element) for element in elements if element is not None]
    if len(lines) < 2:
        file.note("lanelets left out, a bound is missing", i)
        return None
    if not all(np.isfinite(line).all() for line in lines):
        file.note("lanelets left out, a bound has no usable coordinates", i)
        return None
    if any(len(np.unique(line, axis=0)) < 2 for line in lines):
        file.note("lanelets left out, a bound is shorter than two points", i)
        return None
    width = min(line.shape[1] for line in lines)
    return lines[0][:, :width], lines[1][:, :width]


def points_of(line: ElementTree.Element) -> FloatArray:
    """Return (P, 2 or 3) points below an element, m; nan for what is no number."""
    points = line.findall("point")
    names = ("x", "y", "z") if points and all(p.find("z") is not None for p in points) else ("x", "y")
    return np.array([[coordinate(p.findtext(name)) for name in names] for p in points]).reshape(
        -1, len(names)
    )


def library() -> tuple[ReadSign, dict[str, set[str]]]:
    """Return commonroad-io's reader of the name of a sign, by element and country, and its words by tag."""
    with extra_for("CommonRoad maps need commonroad-io", "formats"):
        from commonroad.common.common_lanelet import LaneletType, LineMarking, RoadUser
        from commonroad.common.reader.file_reader_xml import TrafficSignElementFactory
        from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry

    def sign(element: ElementTree.Element, country: str) -> str:
        known = {c.value for c in SupportedTrafficSignCountry}
        # Zamunda is CommonRoad's country of no country; its signs are Germany's.
        where = SupportedTrafficSignCountry(country if country in known else "ZAM")
        read = TrafficSignElementFactory.create_from_xml_node(element, where)
        return str(read.traffic_sign_element_id.name)

    users = {user.value for user in RoadUser}
    return sign, {
        "laneletType": {word.value for word in LaneletType},
        "lineMarking": {word.value for word in LineMarking},
        "userOneWay": users,
        "userBidirectional": users,
    }


def signs_of(file: CommonRoadFile, name_of_sign: ReadSign) -> dict[int, tuple[Sign, ...]]:
    """Return the elements of each sign of a file; the library is quiet about those that it does not know."""
    signs: dict[int, tuple[Sign, ...]] = {}
    logger = logging.getLogger("commonroad")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        for i, element in file.elements("trafficSign").items():
            read = []
            for entry in element.findall("trafficSignElement"):
                written = (entry.findtext("trafficSignID") or "").strip()
                name = name_of_sign(entry, file.country) if written else "UNKNOWN"
                values = tuple((value.text or "").strip() for value in entry.findall("additionalValue"))
                if name == "UNKNOWN":
                    file.note("signs that commonroad-io does not know, left out", i)
                read.append(Sign(name=name, written=written, values=values))
            signs[i] = tuple(read)
    finally:
        logger.setLevel(level)
    return signs
